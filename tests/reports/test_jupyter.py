"""haploop in Jupyter: a notebook is executed by a real kernel, and a cell asks a question."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

import pytest

nbclient = pytest.importorskip(
    "nbclient", reason="nbclient is not installed: python -m pip install -e '.[notebook]'"
)
pytest.importorskip("ipykernel", reason="ipykernel is not installed: python -m pip install -e '.[notebook]'")
pytestmark = pytest.mark.filterwarnings("ignore")  # of Jupyter's own

CELLS = {
    "rig": """
import haploop
rig = haploop.open_rig("simulated").__enter__()
rig
""",
    "recording": """
recording = haploop.record(rig, button="push", participant="P01", presses=3, out="data")
recording
""",
    "press": "press = haploop.representative([recording])\npress",
    "calibration": 'calibration = haploop.calibrate(rig, patch="A", point="button")\ncalibration',
    "drive": "drive = haploop.drive_for(press, calibration, limits=rig.limits)\ndrive",
    "check": "check = haploop.check(rig, drive)\ncheck",
    "button": "haploop.build_button(rig, press, calibration, iterations=0)",
    "plot": "haploop.plot.press(press)",
}
ASK = """
import haploop
from haploop.instruments.operator.console import Console
print(Console().confirm(haploop.instruments.Consent("P01")))
"""


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Any]:
    """What each cell shows, by MIME type."""
    import nbformat

    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text) for text in CELLS.values()])
    folder = tmp_path_factory.mktemp("notebook")
    nbclient.NotebookClient(notebook, timeout=280, resources={"metadata": {"path": str(folder)}}).execute()
    return {
        name: next(one["data"] for one in reversed(cell.outputs) if "data" in one)
        for name, cell in zip(CELLS, notebook.cells, strict=True)
    }


@pytest.mark.parametrize("name", [name for name in CELLS if name != "plot"])
def test_a_cell_shows_facts_and_a_picture(shown, name):
    html, text = shown[name]["text/html"], shown[name]["text/plain"]
    assert len(text) < 160 and "simulated" in text
    assert "<table>" in html and "simulated" in html.lower() and "<script" not in html
    if name == "rig":
        assert "<svg" in html
        return
    picture = html.split("data:image/png;base64,")[1].split('"')[0]
    assert base64.b64decode(picture).startswith(b"\x89PNG")


def test_a_plot_is_shown_as_a_picture(shown):
    assert base64.b64decode(shown["plot"]["image/png"]).startswith(b"\x89PNG")


def test_a_question_is_asked_below_the_cell(tmp_path):
    from jupyter_client.manager import start_new_kernel

    asked: list[str] = []
    said: list[str] = []

    def answer(message):
        asked.append(message["content"]["prompt"])
        client.input("n")

    def heard(message):
        said.append(message["content"].get("text", ""))

    manager, client = start_new_kernel(cwd=str(tmp_path))
    try:
        reply = client.execute_interactive(
            ASK, allow_stdin=True, stdin_hook=answer, output_hook=heard, timeout=120
        )
    finally:
        client.stop_channels()
        manager.shutdown_kernel(now=True)
    assert reply["content"]["status"] == "ok", reply["content"]
    assert asked == ["Has P01 read and signed the consent form? [y/n] "]
    assert "".join(said).strip() == "False"
