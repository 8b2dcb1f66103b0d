"""The tutorials of the site: notebooks that are executed here, and stored with their outputs.

``make notebooks`` executes all of them in place; ``python docs/_notebooks.py NAME ...`` executes
some. The site shows the stored outputs.
"""

from __future__ import annotations

import json
import os
import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nbformat import NotebookNode

ROOT = Path(__file__).resolve().parents[1]
TUTORIALS = ROOT / "docs" / "tutorials"
SECONDS = 600
"""Longest time that a cell may take."""
NEEDED = "executing notebooks needs the docs extra: pip install -c constraints.txt '.[docs]'"
PLACE = re.compile(r"^\S*ipykernel_\S+\.py:\d+: (.*)(?:\n  .*)?$", re.MULTILINE)
"""A warning's place, which names a temporary file, and the line of code that follows it."""


def notebooks() -> list[Path]:
    """Return the notebooks of the tutorials, by name."""
    return sorted(TUTORIALS.glob("*.ipynb"))


def executed(path: Path) -> NotebookNode:
    """Return a notebook with the outputs of a new execution, in an empty folder and on one core.

    Outputs do not depend on the folder or on the time: warnings lose the name of their temporary
    file.

    Raises
    ------
    ImportError
        If Jupyter's libraries are missing; the message says how to install them.
    nbclient.exceptions.CellExecutionError
        If a cell fails.
    """
    try:
        import ipykernel  # noqa: F401
        import nbformat
        from nbclient import NotebookClient
    except ImportError as error:
        raise ImportError(NEEDED) from error
    from bgmodel.support import __version__

    notebook = nbformat.read(path, as_version=4)
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    place = {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    place["COLUMNS"] = ""  # The width of the caller's terminal would set that of tables.
    inline = {"MPLBACKEND": "module://matplotlib_inline.backend_inline"}
    with TemporaryDirectory() as folder:
        client = NotebookClient(
            notebook,
            timeout=SECONDS,
            kernel_name="python3",
            resources={"metadata": {"path": folder}},
            record_timing=False,
            extra_arguments=["--log-level=ERROR"],
        )
        client.execute(env={**os.environ, **threads, **place, **inline})
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = _joined(cell.outputs)
    notebook.metadata = {
        "bgmodel": {"version": __version__},
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    return notebook


def _joined(outputs: list[NotebookNode]) -> list[NotebookNode]:
    """Return outputs in which neighbouring parts of a stream are one, without temporary names."""
    found: list[NotebookNode] = []
    for output in outputs:
        stream = output.output_type == "stream"
        if stream and found and found[-1].get("name") == output.name:
            found[-1].text += output.text
        else:
            found.append(output)
    for output in found:
        if output.output_type == "stream":
            output.text = PLACE.sub(r"\1", output.text)
    return found


def texts(notebook: NotebookNode) -> list[tuple[str, list[Any]]]:
    """Return the outputs of every code cell, with its id, without pictures."""
    outputs = []
    for cell in notebook.cells:
        if cell.cell_type == "code":
            told = [
                output.text
                if output.output_type == "stream"
                else {kind: data for kind, data in output.data.items() if kind.startswith("text")}
                for output in cell.outputs
            ]
            outputs.append((cell.id, told))
    return outputs


def with_download(text: str, name: str) -> str:
    """Return a notebook's JSON with a line on its version, and a link to its file, for the site.

    Parameters
    ----------
    text : str
        The notebook, as stored.
    name : str
        Name of its file.
    """
    notebook = json.loads(text)
    first = notebook["cells"][0]
    version = notebook["metadata"]["bgmodel"]["version"]
    line = f"Executed with bgmodel {version}. Download: {{download}}`{name} <{name}>`."
    first["source"] = f"{''.join(first['source'])}\n\n{line}"
    return json.dumps(notebook)


def main(names: list[str]) -> int:
    """Execute notebooks in place: those of these names, or all."""
    for path in notebooks():
        if not names or path.stem in names:
            try:
                notebook = executed(path)
            except ImportError as error:
                print(error, file=sys.stderr)
                return 1
            import nbformat

            nbformat.write(notebook, path)
            print(f"executed {path.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    sys.exit(main(sys.argv[1:]))
