#!/usr/bin/env -S uv run --script
# /// script
# dependencies = ["nox"]
# ///
"""Tasks: `nox -l` lists them; `nox` runs the checks and the tests, as `.ci/run` does from a clean checkout."""

import nox

nox.needs_version = ">=2024.4"
nox.options.default_venv_backend = "uv|virtualenv"


@nox.session
def lint(session: nox.Session) -> None:
    """Format, lint, types, layers of imports, spelling, Markdown, and what packages of the field have."""
    session.install("-e", ".[dev]")
    session.run("ruff", "format", "--check", ".")
    session.run("ruff", "check", ".")
    session.run("mypy")
    session.run("lint-imports")
    session.run("codespell")
    session.run("rumdl", "check", ".")
    session.run("repo-review", ".")


@nox.session(python=["3.11", "3.12", "3.13"])
def tests(session: nox.Session) -> None:
    """The tests on each Python that is found; words after -- go to pytest."""
    session.install("-e", ".[dev]")
    session.run("pytest", "-n", "2", *session.posargs)


@nox.session(default=False)
def docs(session: nox.Session) -> None:
    """The site, in folder `site`; a broken link is an error."""
    session.install("-e", ".[docs]")
    session.run("mkdocs", "build", "--strict")


@nox.session(default=False)
def package(session: nox.Session) -> None:
    """Wheel and sdist, checked and installed on every Python that is found."""
    session.install("build", "twine", "virtualenv")
    session.run("python", ".ci/package.py")


@nox.session(default=False)
def conda(session: nox.Session) -> None:
    """The recipe for conda-forge, from the sdist; with stand-ins for its channel where that cannot be reached."""
    session.install("-e", ".", "build", "py-rattler-build")
    session.run("python", ".ci/conda.py")


@nox.session(default=False)
def coverage(session: nox.Session) -> None:
    """Lines that tests reach, those of compiled code as plain Python: see docs/architecture.md."""
    session.install("-e", ".[dev]", "pytest-cov")
    session.run("bash", ".ci/coverage", external=True)


@nox.session(default=False)
def instructions(session: nox.Session) -> None:
    """Instructions a step and a call under valgrind, against those that are kept; words after -- go to the script."""
    session.install("-e", ".[dev]")
    session.run("python", "benchmarks/instructions.py", *session.posargs)


@nox.session(default=False)
def benchmarks(session: nox.Session) -> None:
    """Each asv benchmark once, at this commit."""
    session.install("-e", ".[dev]")
    session.run("asv", "run", "--quick", "-E", "existing", "--set-commit-hash", "HEAD")


if __name__ == "__main__":
    nox.main()
