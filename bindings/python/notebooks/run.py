"""Runs the notebooks, whose sources are the scripts beside this one, and keeps what they show.

python run.py [--out DIR]

A script is cut into cells at lines that begin with ``# %%``; ``# %% [markdown]`` begins a cell of text. The
executed notebooks go to DIR, docs/notebooks by default. Real data is read where CHRONOTOPE_DATA names it.
"""

from __future__ import annotations

import argparse
import pathlib

import nbformat
from nbclient import NotebookClient

HERE = pathlib.Path(__file__).resolve().parent
NOTEBOOKS = ("street", "door", "predictions", "grid")


def notebook_of(source: str) -> nbformat.NotebookNode:
    """The cells of a script."""
    cells = []
    for part in source.split("# %%")[1:]:
        head, _, body = part.partition("\n")
        if "[markdown]" in head:
            lines = [line.removeprefix("# ").removeprefix("#") for line in body.strip().splitlines()]
            cells.append(nbformat.v4.new_markdown_cell("\n".join(lines)))
        else:
            cells.append(nbformat.v4.new_code_cell(body.strip()))
    # Numbered, so that the same source gives the same file.
    for at, cell in enumerate(cells):
        cell["id"] = f"cell-{at}"
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return nbformat.v4.new_notebook(cells=cells, metadata={"kernelspec": kernel})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    default = HERE.parents[2] / "docs" / "notebooks"
    parser.add_argument("--out", type=pathlib.Path, default=default)
    parser.add_argument("names", nargs="*", default=NOTEBOOKS)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.names:
        notebook = notebook_of((HERE / f"{name}.py").read_text(encoding="utf-8"))
        NotebookClient(notebook, timeout=900, resources={"metadata": {"path": str(HERE)}}).execute()
        for cell in notebook.cells:
            # When it ran is nobody's interest.
            cell.metadata.pop("execution", None)
        path = options.out / f"{name}.ipynb"
        nbformat.write(notebook, path)
        print(f"{path}: {len(notebook.cells)} cells, {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
