"""What the names of `tcbench` say of themselves, in numpydoc's sections: arguments, shapes, units, errors, sources."""

import builtins
import dataclasses
import inspect
import re
from pathlib import Path

import numpy as np
import pytest

import tcbench
from tcbench import errors

ROOT = Path(__file__).parent.parent
NAMES = [name for name in tcbench.__all__ if name != "hookimpl"]  # which is pluggy's
SECTIONS = ("Parameters", "Attributes", "Returns", "Raises", "References")
UNITS = r"dimensionless|[Ss]econds|[Ii]n points|in inches|in the same time|\bunit\b"
LAST_EQUATION = 45  # of Romero (2009)


def sections(thing):
    """Section -> its lines, and "" -> what stands before the first."""
    found, name = {"": []}, ""
    lines = inspect.getdoc(thing).splitlines()
    for line, below in zip(lines, [*lines[1:], ""], strict=True):
        if below and set(below) == {"-"}:
            name = line
            assert name in SECTIONS, name
            assert len(below) == len(name) and name not in found
            found[name] = []
        elif not (line and set(line) == {"-"}):
            found[name].append(line)
    assert [s for s in SECTIONS if s in found] == [s for s in found if s], "the order of the sections"
    return found


def entries(lines):
    """Name -> (kind, text) of "name : kind" and the lines under it; "x, y : kind" is two."""
    found, last = {}, ""
    for line in lines:
        if line.startswith(" "):
            found[last] = (found[last][0], f"{found[last][1]} {line.strip()}")
        elif line:
            last, _, kind = line.partition(" : ")
            found[last] = (kind, "")
    return {name: told for names, told in found.items() for name in names.split(", ")}


def arguments(thing):
    """Name -> annotation of what a caller gives, or of what a result has."""
    if dataclasses.is_dataclass(thing):
        return {f.name: str(f.type) for f in dataclasses.fields(thing) if not f.name.startswith("_")}
    if inspect.isclass(thing) and issubclass(thing, Exception):
        return {}
    return {
        {p.VAR_KEYWORD: "**", p.VAR_POSITIONAL: "*"}.get(p.kind, "") + p.name: str(p.annotation)
        for p in inspect.signature(thing).parameters.values()
    }


@pytest.mark.parametrize("name", NAMES)
def test_every_argument_is_told_with_its_kind(name):
    thing, told = getattr(tcbench, name), sections(getattr(tcbench, name))
    known = arguments(thing)
    given = entries(told.get("Parameters", told.get("Attributes", [])))
    assert list(given) == list(known), name
    for argument, (kind, text) in given.items():
        assert text.strip(), argument
        assert kind or known[argument] in ("inspect._empty", "Any"), argument
        if "float" in known[argument] and kind != "function":
            everywhere = "dimensionless" in " ".join(told[""])
            assert everywhere or re.search(UNITS, f"{argument} {text}"), f"{name}: the unit of {argument}"
        if re.search("Floats|NDArray|array", known[argument] + kind):
            assert "shape" in kind + text, f"{name}: the shape of {argument}"


@pytest.mark.parametrize("name", NAMES)
def test_results_errors_and_sources_are_told(name):
    thing, told = getattr(tcbench, name), sections(getattr(tcbench, name))
    assert told[""][0].endswith((".", ":")) and told["References"], name
    if inspect.isfunction(thing):
        assert told["Returns"], name
    for error, (kind, text) in entries(told.get("Raises", [])).items():
        assert not kind and text, error
        assert issubclass(getattr(errors, error, None) or getattr(builtins, error), Exception)
    assert told.get("Raises") or not raises(thing), f"{name} raises, and does not say so"


def raises(thing):
    return "raise TcbenchError" in inspect.getsource(thing) or "expect(" in inspect.getsource(thing)


@pytest.mark.parametrize("name", NAMES)
def test_a_source_is_an_equation_of_the_paper_or_a_page(name):
    text = " ".join(sections(getattr(tcbench, name))["References"])
    pages = re.findall(r"docs/[\w-]+\.md", text)
    numbers = [int(n) for n in re.findall(r"\((\d+)\)", text.replace("(2009)", ""))]
    assert pages or numbers, name
    assert all((ROOT / page).is_file() for page in pages)
    assert all(1 <= n <= LAST_EQUATION for n in numbers)


def test_every_method_and_property_says_what_it_is_and_arrays_their_shape():
    silent, shapeless = [], []
    for name in NAMES:
        thing = getattr(tcbench, name)
        for member, value in vars(thing).items() if inspect.isclass(thing) else ():
            function = next((getattr(value, way) for way in ("fget", "func", "__func__") if hasattr(value, way)), value)
            if member.startswith("_") or not inspect.isfunction(function):
                continue
            text = function.__doc__ or inspect.getdoc(getattr(thing, member)) or ""  # an own one, or the base's
            if not text:
                silent.append(f"{name}.{member}")
            elif re.search(r"NDArray|Floats|Array", str(function.__annotations__.get("return", ""))):
                shapeless += [] if re.search(r"shape \(|\(m", text) else [f"{name}.{member}"]
    assert not silent and not shapeless


def test_shapes_in_the_text_are_those_of_a_run():
    run = tcbench.simulate("tc_monolithic", "short_term", t_end=3.0)
    m, n, n_temperatures = len(run.t), run.scenario.model.size, run.scenario.model.n_temperatures
    sizes = {"m": m, "n": n, "n_temperatures": n_temperatures, "m - 1": m - 1}
    for names, (kind, _) in entries(sections(tcbench.Trajectory)["Attributes"]).items():
        value = getattr(run, names)
        if kind.startswith("array"):
            told = [sizes[word.strip()] for word in re.search(r"shape \((.*)\)", kind)[1].split(",") if word.strip()]
            assert np.shape(value) == tuple(told), names
        elif kind.startswith("mapping of str to array"):
            assert all(np.shape(x) == (m,) for x in value.values()) and value
