"""Errors that a user can cure: each says what is wrong, what exists and what to do."""

from __future__ import annotations

import difflib
import fnmatch
import math
import os
import re
import traceback
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from numbers import Integral, Real
from pathlib import Path
from typing import Any, TypeVar

Value = TypeVar("Value")
# How a run, or the cell of a run, can end: the one list of these words.
STATUSES = (
    "ok", "nonconverged", "no_root", "nonfinite", "unphysical", "blowup", "exception", "crash", "timeout", "skipped",
)  # fmt: skip
LOUD = ("exception", "crash", "timeout")  # faults; a method that fails otherwise is a result, not an alarm
UNFINISHED = ("crash", "timeout")  # what the machine or a limit did to a cell: worth another attempt
# what formulas of methods ask for, and systems of elements alone have
OF_ELEMENTS = ("L", "DS", "dissipation", "conduction", "inertia", "shape", "shape_gradient", "element_energy")
OURS = Path(__file__).parent
INSTALLED = {"site-packages", "dist-packages"}


class TcbenchError(Exception):
    """A mistake in the input, as one sentence: what is wrong, what exists, what to do.

    The command line prints the sentence and exits with code 2. A run that fails raises none: its `Trajectory`, or its
    row, says so.

    References
    ----------
    docs/measures.md lists the statuses of runs.
    """


class UnknownNameError(TcbenchError, KeyError):
    """A name that nothing is registered under. A KeyError, as of any dictionary, whose text is the sentence."""

    __str__ = Exception.__str__


class TraceError(TcbenchError):
    """A formula that cannot be turned into compiled code; the message names the line and a remedy."""


class MachineError(TcbenchError):
    """A full disk, a folder that cannot be written, a package that is absent: not the method's fault, so that its cell
    is to be run again."""


def leave_to_the_machine(error: Exception) -> None:
    """Raise what is no method's fault, for whoever catches a method's exceptions; return where the error is one.

    Memory, disks, and modules that are absent: another day the cell ends otherwise.
    """
    if isinstance(error, MachineError | MemoryError):
        raise error
    if isinstance(error, ImportError | OSError):
        raise MachineError(f"{type(error).__name__}: {error}") from error


class ChangedError(TcbenchError):
    """Code that a session changed after it was imported, so that another process would compute something else."""


@contextmanager
def writing(what: object) -> Iterator[None]:
    """What the block writes, such as a path; where it cannot, the sentence says so."""
    try:
        yield
    except OSError as error:
        raise TcbenchError(f"{what} cannot be written: {error.strerror or error}.") from None


def needs_folder(path: Path) -> None:
    """Refuses a file to write whose folder is not there."""
    if not os.path.isdir(os.path.dirname(os.path.realpath(path))):
        raise TcbenchError(f"The folder of {str(path)!r} does not exist; create it first.")


KINDS: dict[str, Callable[[Any], bool]] = {  # what an argument may be -> whether it is that
    "a word": lambda v: isinstance(v, str),
    "a number": lambda v: isinstance(v, Real) and not isinstance(v, bool),
    "a whole number": lambda v: isinstance(v, Integral) and not isinstance(v, bool),
    "True or False": lambda v: isinstance(v, bool),
    "a function": callable,
    "a class": lambda v: isinstance(v, type),
    "a mapping": lambda v: isinstance(v, Mapping) and all(isinstance(k, str) for k in v),
    "a path": lambda v: isinstance(v, str | os.PathLike),
    "numbers": lambda v: several(v) and not isinstance(v, Mapping),
    "words": lambda v: several(v) and isinstance(v, Collection) and all(isinstance(w, str) for w in v),
}


def several(value: Any) -> bool:
    """Can it be walked over, and is no text? (An array of no dimension only says that it can.)"""
    try:
        return iter(value) is not None and not isinstance(value, str | bytes)
    except TypeError:
        return False


def expect(where: str, values: Mapping[str, Any], kinds: Mapping[str, str]) -> None:
    """Raise TcbenchError for the first value that is not what it is to be.

    kinds : argument -> names of KINDS, alternatives joined by " or "; "nothing" is None.
    """
    for name, kind in kinds.items():
        value = values[name]
        if not any(value is None if way == "nothing" else KINDS[way](value) for way in ways_of(kind)):
            remedy = f" Write [{shown(value)}]." if "numbers" in kind and KINDS["a number"](value) else ""
            raise TcbenchError(f"{where}: {name} must be {kind}, not {shown(value)}.{remedy}")


def expect_words(where: str, values: Mapping[str, Any], *names: str) -> None:
    """Raise TcbenchError for the first of these values that is no tuple of words: of a word alone letters are taken."""
    for name in names:
        if not KINDS["words"](value := values[name]):
            raise TcbenchError(f"{where}: {name} is a tuple of words, {name}=('one', 'two'), not {shown(value)}.")


def expect_names(where: str, *names: Any) -> None:
    """Raise TcbenchError for the first that cannot be a name on a command line, of a file and of a column."""
    for name in names:
        if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z0-9_-]+", name):
            raise TcbenchError(f"{where}: {shown(name)} cannot be a name: use letters, digits, '_' and '-'.")


def positive(name: str, value: Any) -> float:
    """The value of an argument as a finite number above 0, or the error that says what is wrong with it."""
    try:
        number = math.nan if isinstance(value, bytes | bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        raise TcbenchError(f"{name} must be a number, not {shown(value)}.") from None
    if not (math.isfinite(number) and number > 0):
        raise TcbenchError(f"{name} must be positive and finite, not {shown(value)}.")
    return number


@cache
def ways_of(kind: str) -> tuple[str, ...]:
    """The names in "a number or True or False or nothing"."""
    return tuple(way for way in (*KINDS, "nothing") if f" or {way} or " in f" or {kind} or ")


def shown(value: Any) -> str:
    """A value in a sentence: never an exception, nor a page."""
    try:
        text = repr(value)
    except Exception:
        text = f"a {type(value).__name__}"
    return text if len(text) <= 80 else f"{text[:77]}..."


CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def visible(text: str) -> str:
    """A text for a terminal: characters that would move its cursor, change its colours or turn the line are spelt."""
    return CONTROL.sub(lambda match: ascii(match[0])[1:-1], text)


def unknown_name(kind: str, name: str, existing: Iterable[str], remedy: str = "", cause: str = "") -> UnknownNameError:
    """The error for a mistyped name: what may be the cause, the nearest match, everything that exists, what to do."""
    names = sorted(existing)
    close = [] if is_pattern(name) else difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    guess = f" Did you mean {close[0]!r}?" if close else ""
    listing = f" Known: {', '.join(names)}." if names else f" No {kind} is registered."
    cause, remedy = (f" {text}" if text else "" for text in (cause, remedy))
    called = "fits the pattern" if is_pattern(name) else "is called"
    return UnknownNameError(f"No {kind} {called} {name!r}.{cause}{guess}{listing}{remedy}")


class ByName(dict[str, Value]):
    """Things by name: an unknown one is refused with the sentence of `unknown_name`."""

    def __init__(self, kind: str, values: Mapping[str, Value]) -> None:
        super().__init__(values)
        self.kind = kind

    def __missing__(self, name: str) -> Value:
        raise unknown_name(self.kind, str(name), self)

    def __reduce__(self) -> Any:
        return ByName, (self.kind, dict(self))


def misnamed(error: BaseException) -> str:
    """What an exception says, in a line, and of an attribute that an object does not have the nearest that it has."""
    text = f"{type(error).__name__}: {str(error).splitlines()[0][:300]}" if str(error) else type(error).__name__
    if isinstance(error, AttributeError) and isinstance(error.name, str):
        if error.name in ("hypot", "arctan2"):  # numpy asks the first argument
            return f"np.{error.name} of a number and a formula: write the number a as a + 0 * x, x the formula"
        who = getattr(error.obj, "__name__", type(error.obj).__name__)
        if error.name in OF_ELEMENTS and hasattr(error.obj, "discrete_gradients"):
            return (
                f"{who!r} has no {error.name!r}: it is of springs and other elements. Every system has "
                "reversible(z, DE, DS) and irreversible(z, DE, DS); what is for elements alone says elements=True"
            )
        names = [name for name in dir(error.obj) if not name.startswith("_")]
        if close := difflib.get_close_matches(error.name, names, n=1):
            return f"{who!r} has no {error.name!r} (did you mean {close[0]!r}?)"
    if matrix := re.search("cast ufunc '([a-z]+)1?' input.*dtype.'O'", text):  # of numpy.linalg, which has no objects
        return (
            f"np.linalg.{matrix[1]} of formulas runs on tensors over a space alone. Write it out: [[a, b], [c, d]] has "
            "the inverse [[d, -b], [-c, a]] / (a d - b c)"
        )
    return text


def blamed(error: BaseException) -> str:
    """One line for an exception in a plugin: type, message, and the innermost line of its own code, if there is one."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if not Path(f.filename).is_relative_to(OURS)]
    frames = [f for f in frames if not INSTALLED.intersection(Path(f.filename).parts)] or frames
    where = f" at {Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""
    return f"{misnamed(error)}{where}"


def ending(error: BaseException) -> tuple[str, str]:
    """Status and one line for an exception that ended a run. A solver that gives up raises ArithmeticError itself; one
    of its kinds, as a division by zero, and all others are faults."""
    if type(error) is ArithmeticError:
        return "nonconverged", str(error) or "the solver gave up"
    return "exception", blamed(error)


@contextmanager
def calling(what: str) -> Iterator[None]:
    """The block calls a plugin's function: what that raises is a sentence that begins with `what`."""
    try:
        yield
    except (TcbenchError, MemoryError):
        raise
    except Exception as error:
        raise TcbenchError(f"{what}: {blamed(error)}.") from error


def matching(kind: str, name: str, existing: Iterable[str], remedy: str = "", cause: str = "") -> list[str]:
    """The names that `name` means: itself, or those that fit a pattern with * or ?; an error where there is none."""
    names = list(existing)
    chosen = [name] if name in names else []
    if not chosen and is_pattern(name):
        chosen = [one for one in names if fnmatch.fnmatchcase(one, name.replace("[", "[[]"))]
    if not chosen:
        raise unknown_name(kind, name, names, remedy, cause)
    return chosen


def is_pattern(name: str) -> bool:
    """Is a name written with * or ?, to mean several?"""
    return "*" in name or "?" in name
