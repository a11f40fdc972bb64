"""The notebooks run as Jupyter runs them, show tables and figures, and say what they should."""

import re
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
FIGURES = {"paper": 6, "new-button": 4, "last-night": 2, "mock-rig-in-ci": 1}
"""Least number of pictures of each."""
REASON = 'nbclient is not installed: python -m pip install -e ".[notebook]"'


def outputs(name: str, folder: Path) -> list[Any]:
    """Everything that the cells of a notebook put out, once they have run in an empty folder."""
    nbformat = pytest.importorskip("nbformat", reason=REASON)
    nbclient = pytest.importorskip("nbclient", reason=REASON)
    pytest.importorskip("ipykernel", reason=REASON)
    notebook = nbformat.read(EXAMPLES / f"{name}.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "clear the outputs before you commit"
    resources = {"metadata": {"path": str(folder)}}
    nbclient.NotebookClient(notebook, timeout=500, kernel_name="python3", resources=resources).execute()
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def pictures(found: list[Any]) -> int:
    data = [output.get("data", {}) for output in found]
    return sum("image/png" in one or "data:image/png" in one.get("text/html", "") for one in data)


def text(found: list[Any]) -> str:
    return "\n".join(str(one.get("text", one.get("data", {}).get("text/plain"))) for one in found)


def test_every_notebook_is_run():
    assert {path.stem for path in EXAMPLES.glob("*.ipynb")} == set(FIGURES)


@pytest.mark.timeout(600)
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.night] * (n in ("paper", "last-night"))) for n in FIGURES]
)
def test_a_notebook_runs(name, tmp_path):
    pytest.importorskip("pandas", reason="pandas is not installed: a recording becomes a table of it")
    found = outputs(name, tmp_path)
    assert not [output for output in found if output.get("name") == "stderr"]
    assert pictures(found) >= FIGURES[name]
    said = text(found)
    if name == "paper":
        forces = {button: float(newton) for button, newton in re.findall(r"'(\w+)': ([0-9.]+)", said)}
        assert forces["latch"] > forces["push"] > forces["toggle"]
        (resonance,) = re.findall(r"^([0-9.]+) Hz, damping", said, re.MULTILINE)
        assert abs(float(resonance) - 263.2) < 1  # of the simulated table; the paper's is at 263.5 Hz
        assert len(re.findall(r"^(?:latch|toggle|push): pass, error", said, re.MULTILINE)) == 3
    elif name == "new-button":
        assert re.search(r"\(10, \d+\) channels and samples", said)
        assert re.search(r"^pass: error", said, re.MULTILINE)
    elif name == "last-night":
        assert re.findall(r"  (unchanged|restored|drifted|broken): ", said) == [
            "unchanged",
            "unchanged",
            "restored",
        ]
    else:
        seen, true = map(float, re.findall(r"found ([0-9.]+) Hz, true ([0-9.]+) Hz", said)[0])
        assert abs(seen - true) < 0.1
        assert "reads open" in said and "fired 1 times" in said
