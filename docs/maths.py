"""mkdocs hook: $...$ and $$...$$ become MathML when the site is built, so that pages need no script and no network."""

import re

from latex2mathml.converter import convert

CODE = re.compile(r"(^```.*?^```|^ {4,}[^\n]*$|`[^`\n]+`)", re.DOTALL | re.MULTILINE)
BLOCK = re.compile(r"\$\$(.+?)\$\$", re.DOTALL)
INLINE = re.compile(r"(?<![\\$\w])\$(?! )([^$\n]+?)(?<! )\$(?!\w)")


def on_page_markdown(markdown, **_):
    """Formulas outside code, converted."""
    pieces = CODE.split(markdown)
    return "".join(piece if i % 2 else _converted(piece) for i, piece in enumerate(pieces))


def _converted(text):
    text = BLOCK.sub(lambda m: f"\n\n{convert(m[1].strip(), display='block')}\n\n", text)
    return INLINE.sub(
        lambda m: f"<span>{convert(m[1])}</span>", text
    )  # a line that begins with <math> would be a block
