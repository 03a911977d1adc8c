"""Builds the recipe for conda-forge from the sdist of this checkout, with rattler-build (pip install py-rattler-build).

Its channel is conda-forge where that can be reached, and the tests of the recipe run. Elsewhere a folder stands in for
it, with this Python and the tools of the build, and what was built is looked at and run by this Python.
"""

import hashlib
import json
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import urllib.request
from pathlib import Path

import rattler_build as rattler

ROOT = Path(__file__).parent.parent
CHANNEL = "https://conda.anaconda.org/conda-forge"
TOOLS = {"pip": "25.0", "setuptools": "80.0", "setuptools-scm": "10.0"}  # of the build: packages that stand in for them
SELECTION = ["run", "-i", "tc_monolithic", "-s", "short_term", "--study", "conservation"]


def can_be_reached(url):
    try:
        with urllib.request.urlopen(f"{url}/noarch/repodata.json.zst", timeout=10):
            return True
    except OSError:
        return False


def stand_in(folder):
    """A channel of a Python whose pip installs into the environment that it stands in, and of empty tools."""
    subprocess.run([sys.executable, "-m", "venv", folder / "venv"], check=True)
    python = folder / "venv" / "bin" / "python"
    subprocess.run([python, "-m", "pip", "install", "-q", "setuptools>=77", "setuptools-scm>=10"], check=True)
    (folder / "files" / "bin").mkdir(parents=True)
    program = folder / "files" / "bin" / "python"
    program.write_text(f'#!/bin/sh\nPIP_PREFIX="$(dirname "$(dirname "$0")")" exec {python} "$@"\n')
    program.chmod(0o755)
    (folder / "empty").mkdir()
    version = ".".join(map(str, sys.version_info[:3]))
    for name, number in {"python": version, **TOOLS}.items():
        platform = "linux-64" if name == "python" else "noarch"
        place = folder / "channel" / platform
        place.mkdir(parents=True, exist_ok=True)
        rattler.assemble_package(
            name=name, version=number, target_platform=platform, build_string="0", output_dir=place,
            files_dir=folder / ("files" if name == "python" else "empty"), archive_type=rattler.ArchiveType.TarBz2,
        )  # fmt: skip
    for place in (folder / "channel").iterdir():
        found = {}
        for path in place.rglob("*.tar.bz2"):
            path = path.rename(place / path.name)
            with tarfile.open(path) as archive:
                about = json.load(archive.extractfile("info/index.json"))
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            found[path.name] = about | {"sha256": digest, "size": path.stat().st_size}
        text = {"info": {"subdir": place.name}, "packages": found, "packages.conda": {}, "repodata_version": 1}
        (place / "repodata.json").write_text(json.dumps(text))
    return (folder / "channel").as_uri()


def main():
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run([sys.executable, "-m", "build", "--sdist", "--outdir", folder, ROOT], check=True)
        (sdist,) = folder.glob("*.tar.gz")
        version = re.fullmatch(r"tcbench-(.*)\.tar\.gz", sdist.name)[1].partition("+")[0]
        text = (ROOT / "conda" / "recipe.yaml").read_text()
        text = re.sub(r'version: "[^"]*"', f'version: "{version}"', text, count=1)
        digest = hashlib.sha256(sdist.read_bytes()).hexdigest()
        text = re.sub(r"url: https://pypi.*", f"url: {sdist.as_uri()}\n  sha256: {digest}", text)
        (folder / "recipe").mkdir()
        (folder / "recipe" / "recipe.yaml").write_text(text)
        whole = can_be_reached(CHANNEL)
        tool = rattler.ToolConfiguration(test_strategy="native" if whole else "skip")
        channels = [CHANNEL if whole else stand_in(folder)]
        recipe = rattler.Stage0Recipe.from_file(folder / "recipe" / "recipe.yaml")
        (result,) = recipe.run_build(tool_config=tool, channels=channels, output_dir=folder / "built",
                                     package_format="tar.bz2")  # fmt: skip
        print(f"built {result.packages[0]} with {'conda-forge' if whole else 'stand-ins'}")
        with tarfile.open(result.packages[0]) as archive:
            archive.extractall(folder / "package", filter="data")
        check(folder / "package")


def check(folder):
    """What was built has the program, its entry point, licences and dependencies, and runs."""
    about = json.loads((folder / "info" / "index.json").read_text())
    assert about["noarch"] == "python" and any(d.startswith("numpy") for d in about["depends"]), about
    link = json.loads((folder / "info" / "link.json").read_text())
    assert link["noarch"]["entry_points"] == ["tcbench = tcbench.cli:main"], link
    assert len(list((folder / "info" / "licenses").rglob("*.txt"))) >= 2
    place = folder / "site-packages"
    assert (place / "tcbench" / "py.typed").is_file() and (place / "tcbench_plugins" / "tc_monolithic.py").is_file()
    environment = os.environ | {"PYTHONPATH": str(place), "PYTHONSAFEPATH": "1"}
    code = "import sys, tcbench; print(tcbench.__file__); from tcbench.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", code, *SELECTION], cwd=folder, env=environment, check=True,
                          capture_output=True, text=True)  # fmt: skip
    assert str(place) in done.stdout, done.stdout
    print(f"the package runs: {len(about['depends'])} dependencies, {about['name']} {about['version']}")


if __name__ == "__main__":
    main()
