"""mkdocs hook: every notebook becomes a page of the site, with the outputs that it was saved with."""

import json
from pathlib import Path

from mkdocs.structure.files import File

NOTEBOOKS = Path(__file__).parent / "notebooks"


def on_files(files, config):
    """The pages of the notebooks, beside the files themselves, which can be downloaded."""
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        page = f"notebooks/{path.stem}.md"
        files.append(File.generated(config, page, content=rendered(path)))
    return files


def rendered(path):
    """A notebook as Markdown: its cells in order, below each what it printed and drew."""
    cells = json.loads(path.read_text("utf-8"))["cells"]
    texts = [_text(cell) for cell in cells]
    download = f"[Download this notebook]({path.name}) and run it beside an installed tcbench.\n"
    title, _, rest = texts[0].partition("\n")
    return "\n\n".join([title, download, rest, *texts[1:]])


def _text(cell):
    source = "".join(cell["source"])
    if cell["cell_type"] != "code":
        return source
    return "\n\n".join([f"```python\n{source}\n```", *filter(None, map(_shown, cell.get("outputs", [])))])


def _shown(output):
    data = output.get("data", {})
    if "image/png" in data:
        return f'<img alt="what the cell above draws" src="data:image/png;base64,{"".join(data["image/png"]).strip()}">'
    if "text/html" in data:
        return "".join(data["text/html"])
    text = "".join(output.get("text", data.get("text/plain", "")))
    return f"```text\n{text.rstrip()}\n```" if text.strip() else ""
