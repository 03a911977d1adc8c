"""Builds the sdist and the wheel, looks into both, and runs them on each Python that is found, without the repository.

For each interpreter: a fresh environment, the wheel, README's first command on a small selection from an empty
folder, and from the unpacked sdist the tests of the command line; on Pythons other than this one the laws, too.
TCBENCH_PYTHONS adds interpreters, separated as in PATH.
"""

import email
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
TESTS = ["tests/test_cli.py"]
LAWS = ["tests/laws"]  # not on this Python: the suite has just run them here
TOOLS = ["pytest>=8.2", "pytest-xdist>=3.6", "hypothesis>=6.100", "mpmath>=1.3"]
SELECTION = ["-i", "tc_monolithic", "-i", "midpoint_temperature", "-s", "short_term", "--study", "conservation"]


def run(*command, cwd=None, **options):
    words = [str(word) for word in command]
    print("$", *words, flush=True)
    subprocess.run(words, cwd=cwd, check=True, **options)


def interpreters():
    """(version, path) of each Python from 3.11 that starts and can make an environment, this one first."""
    named = [f"python3.{minor}" for minor in range(11, 16)]
    found = [sys.executable, *filter(None, map(shutil.which, named))]
    found += [path for path in os.environ.get("TCBENCH_PYTHONS", "").split(os.pathsep) if path]
    code = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"
    versions = {}
    for path in found:
        done = subprocess.run([path, "-c", code], capture_output=True, text=True, check=False)
        if done.returncode == 0:
            versions.setdefault(done.stdout.strip(), path)
        else:
            print(f"{path} is left out: {(done.stderr.strip().splitlines() or ['it does not start'])[-1]}")
    return versions


def build(folder):
    """Paths of the sdist, and of the wheel that is built from it."""
    run(sys.executable, "-m", "build", "--outdir", folder, ROOT)
    (sdist,), (wheel,) = folder.glob("*.tar.gz"), folder.glob("*.whl")
    run(sys.executable, "-m", "twine", "check", "--strict", sdist, wheel)
    return sdist, wheel


def look_at(sdist, wheel):
    """The sdist has every file that git knows, the wheel the program and nothing else, its metadata what is true."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    files = {name for name in listed if (ROOT / name).is_file()}
    with tarfile.open(sdist) as archive:
        missing = files - {name.partition("/")[2] for name in archive.getnames()}
    assert not missing, f"the sdist lacks {missing}"
    archive = zipfile.ZipFile(wheel)
    names = archive.namelist()
    code = {n.replace("plugins/", "tcbench_plugins/", 1) if n.startswith("plugins/") else n
            for n in files if n.startswith(("tcbench/", "plugins/"))}  # fmt: skip
    assert code == {n for n in names if ".dist-info/" not in n}, "the wheel has other files than tcbench/ and plugins/"
    found = email.message_from_bytes(archive.read(next(n for n in names if n.endswith(".dist-info/METADATA"))))
    assert re.fullmatch(r"\d+\.\d+\.\d+(\.dev\d+)?", found["Version"].partition("+")[0]), found["Version"]
    for licence in ("LICENSE", "fdlibm.txt", "vendor/LICENSES.txt"):
        assert any(".dist-info/licenses/" in n and n.endswith(licence) for n in names), licence
    links = [t for t in re.findall(r"\]\(([^)]*)\)", found.get_payload()) if not t.startswith(("http", "#"))]
    assert not links, f"the text for a package index links to {links}"


def try_on(python, wheel, source, folder):
    """The wheel in a fresh environment of this interpreter."""
    run(python, "-m", "venv", folder)
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    run(programs / "python", "-m", "pip", "install", "--quiet", wheel, *TOOLS)
    empty = folder / "empty"
    empty.mkdir()
    run(programs / "tcbench", "run", *SELECTION, cwd=empty)
    run(programs / "pytest", "-n", "2", *TESTS, *([] if python == sys.executable else LAWS), cwd=source)


def main():
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ.setdefault("TCBENCH_CACHE_DIR", str(folder / "cache"))
        sdist, wheel = build(folder / "dist")
        look_at(sdist, wheel)
        with tarfile.open(sdist) as archive:
            archive.extractall(folder, filter="data")
        source = folder / sdist.name.removesuffix(".tar.gz")
        shutil.rmtree(source / "tcbench")  # what is tested is what was installed
        versions = interpreters()
        for version, python in versions.items():
            print(f"--- Python {version}", flush=True)
            try_on(python, wheel, source, folder / version)
        print(f"The package works on Python {', '.join(versions)}.")


if __name__ == "__main__":
    main()
