"""The long description of a package index: README.md without what only the repository has: pictures, links to files."""

import re
from pathlib import Path

from setuptools import setup

PICTURE = re.compile(r"^\[?!\[[^\]]*\]\((?!https?:)[^)]*\)(\]\([^)]*\))?\n+", re.MULTILINE)  # of a link, too
LINK = re.compile(r"\[([^\]]*)\]\((?!https?:|#)[^)]*\)")

readme = Path(__file__).with_name("README.md").read_text(encoding="utf-8")
setup(
    long_description=LINK.sub(r"`\1`", PICTURE.sub("", readme)),
    long_description_content_type="text/markdown",
)
