"""How-to guides, a to l: every block runs."""

import shutil

import pytest

from tests.documents.pages import SHARES, name_of, pages_of, run_blocks


@pytest.mark.skipif(shutil.which("bash") is None, reason="the blocks are for bash")
@pytest.mark.timeout(900)  # a page is a program, and several run at once
@pytest.mark.parametrize("path", pages_of(*SHARES["how-to a-l"]), ids=name_of)
def test_the_blocks_of_a_page_run(path, tmp_path, monkeypatch):
    run_blocks(path, tmp_path, monkeypatch)
