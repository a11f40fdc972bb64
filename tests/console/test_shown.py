"""What a page asks for while another one waits for a report."""

import importlib
import re
import shutil
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from haploop.console.data_folder import DataFolder
from haploop.console.server.shown_routes import figure, report
from haploop.reports.html import write_report

PATIENCE = 60.0


@pytest.mark.long
def test_figures_are_drawn_while_a_report_is_being_made(made, tmp_path, monkeypatch):
    """The report held the lock of all drawing while it read its data, and wrote files that nobody saw."""
    data = DataFolder(tmp_path / "data", tmp_path / "history")
    data.root.mkdir()
    shutil.copy(made / "latch.h5", data.root / "latch.h5")
    files = importlib.import_module("haploop.reports.html.files")
    read, reading, go = files.read_sections, threading.Event(), threading.Event()

    def slow(*of):
        reading.set()
        assert go.wait(PATIENCE)
        return read(*of)

    monkeypatch.setattr(files, "read_sections", slow)
    asked = {"file": "latch.h5"}
    with ThreadPoolExecutor(2) as pool:
        page = pool.submit(report, data, asked)
        assert reading.wait(PATIENCE)
        drawn = pool.submit(figure, data, {**asked, "as": "csv"})
        try:
            assert bytes(drawn.result(PATIENCE).body).startswith(b"panel,curve")
        finally:
            go.set()
        body = bytes(page.result(PATIENCE).body)
    monkeypatch.undo()
    whole = write_report(data.root / "latch.h5", tmp_path / "report.html").html.read_bytes()
    beside = re.compile(rb"In the folder beside this page: [^\n]*(?=</figcaption>)")
    instead = re.compile(
        rb'\n<p class="aside">[^\n]*<code>haploop figures latch\.h5 --out figures</code></p>'
    )
    assert beside.search(whole) and instead.search(body)
    assert instead.sub(b"", body) == beside.sub(b"", whole), "the page of the command, with figures beside it"
