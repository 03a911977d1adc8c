"""What is handed out: the sdist has everything, the wheel what runs, and the metadata say what is true."""

import email
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def git(*words, cwd=ROOT):
    return subprocess.run(["git", *words], cwd=cwd, capture_output=True, text=True, check=True).stdout


def copy_of_the_checkout(folder):
    """The files that git knows, as they are now, in a repository of their own without a tag."""
    try:
        files = git("ls-files").split()
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("this is not a checkout")
    for name in files:
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, folder / name)
    git("init", "-q", cwd=folder)
    git("add", "-A", cwd=folder)
    git("-c", "user.name=x", "-c", "user.email=x@example.org", "commit", "-qm", "all", cwd=folder)
    return files


def build(what, source, folder):
    code = f"import sys; from setuptools import build_meta as b; print(b.build_{what}(sys.argv[1]))"
    done = subprocess.run([sys.executable, "-c", code, folder], cwd=source, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / done.stdout.split()[-1]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Tracked files, the sdist, and the wheel that is built from the sdist without git."""
    pytest.importorskip("setuptools_scm")
    folder = tmp_path_factory.mktemp("package")
    files = copy_of_the_checkout(folder / "source")
    sdist = build("sdist", folder / "source", folder)
    with tarfile.open(sdist) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    (source,) = (folder / "unpacked").iterdir()
    return files, sdist, build("wheel", source, folder)


def test_the_sdist_has_every_file_of_the_checkout(built):
    files, sdist, _ = built
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert not [name for name in files if (ROOT / name).is_file() and name not in names]
    assert {"tests/conftest.py", "docs/index.md", "examples/net_beside_bdf.py", "CITATION.cff"} <= names


def test_the_wheel_has_the_program_and_nothing_else(built):
    files, _, wheel = built
    names = set(zipfile.ZipFile(wheel).namelist())
    code = {name.replace("plugins/", "tcbench_plugins/", 1) if name.startswith("plugins/") else name
            for name in files if name.startswith(("tcbench/", "plugins/")) and (ROOT / name).is_file()}  # fmt: skip
    assert code == {name for name in names if ".dist-info/" not in name}


def metadata(wheel):
    archive = zipfile.ZipFile(wheel)
    name = next(name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
    return email.message_from_bytes(archive.read(name)), archive.namelist()


def test_the_metadata(built):
    found, names = metadata(built[2])
    assert re.fullmatch(r"\d+\.\d+\.\d+(\.dev\d+)?", found["Version"].partition("+")[0]), found["Version"]
    assert found["License-Expression"] == PROJECT["project"]["license"]
    for licence in ("LICENSE", "fdlibm.txt", "vendor/LICENSES.txt"):
        assert any(".dist-info/licenses/" in name and name.endswith(licence) for name in names), licence
    versions = {c.rpartition(":: ")[2] for c in found.get_all("Classifier") if ":: Python :: 3." in c}
    assert versions == {"3.11", "3.12", "3.13", "3.14"} and found["Requires-Python"] == ">=3.11"


def test_the_text_for_a_package_index_links_to_nothing_that_is_not_there(built):
    text = metadata(built[2])[0].get_payload()
    assert "# tcbench" in text and "tcbench run" in text
    assert not [t for t in re.findall(r"\]\(([^)]*)\)", text) if not t.startswith(("http", "#"))]


def test_the_licence_expression_covers_what_the_page_embeds():
    vendor = ROOT / "tcbench" / "report" / "templates" / "vendor"
    text = (vendor / "LICENSES.txt").read_text()
    for path in vendor.iterdir():
        assert path.name == "LICENSES.txt" or path.name in text, f"{path.name} has no licence in LICENSES.txt"
    named = {"MIT": "MIT", "ISC": "ISC", "Apache": "Apache-2.0", "BSD": "BSD-3-Clause"}
    for word, licence in named.items():
        if re.search(rf"\b{word}\b", text):
            assert licence in PROJECT["project"]["license"], f"{licence} is missing in the licence expression"


def test_a_copy_without_git_has_a_version(tmp_path):
    pytest.importorskip("setuptools_scm")
    shutil.copyfile(ROOT / "pyproject.toml", tmp_path / "pyproject.toml")
    code = "import setuptools_scm as s; print(s._get_version(s.Configuration.from_file('pyproject.toml')))"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == PROJECT["tool"]["setuptools_scm"]["fallback_version"]


def test_the_citation_names_the_paper_and_the_people():
    text = (ROOT / "CITATION.cff").read_text()
    assert "cff-version: 1.2.0" in text and "doi: 10.1002/nme.2588" in text
    assert PROJECT["project"]["authors"][0]["name"] in text and PROJECT["project"]["urls"]["Paper"].endswith("nme.2588")


def test_the_recipe_for_conda_asks_for_what_the_package_needs():
    recipe = pytest.importorskip("yaml").safe_load((ROOT / "conda" / "recipe.yaml").read_text())
    project, renamed = PROJECT["project"], {"matplotlib": "matplotlib-base"}

    def asked(requirements):
        pairs = (re.fullmatch(r"([\w.-]+)>=([\d.]+)", r).groups() for r in requirements if ";" not in r)
        return [f"{renamed.get(name, name)} >={version}" for name, version in pairs]

    assert recipe["requirements"]["run"] == ["python >=${{ python_min }}", *asked(project["dependencies"])]
    assert recipe["requirements"]["host"][2:] == asked(PROJECT["build-system"]["requires"])
    assert project["requires-python"] == f">={recipe['context']['python_min']}"
    assert recipe["build"]["python"]["entry_points"] == [f"{k} = {v}" for k, v in project["scripts"].items()]
    about = recipe["about"]
    assert (about["license"], about["summary"]) == (project["license"], project["description"])
    assert all((ROOT / path).exists() for path in about["license_file"])


def test_the_group_dev_installs_what_the_extra_dev_installs():
    groups, extras = PROJECT["dependency-groups"], PROJECT["project"]["optional-dependencies"]

    def flat(entries, known):
        for entry in entries:
            if isinstance(entry, dict):
                yield from flat(known[entry["include-group"]], known)
            elif entry.startswith("tcbench["):
                for extra in entry[len("tcbench[") : -1].split(","):
                    yield from flat(extras[extra], known)
            else:
                yield entry

    assert set(flat(groups["dev"], groups)) == set(flat(extras["dev"], groups))
