"""These tests are of the drivers themselves, which close no contact without a rig."""

import pytest


@pytest.fixture(autouse=True)
def _switching(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("haploop.instruments.interlock._NoRig.authorise_patches", lambda *_: None)
