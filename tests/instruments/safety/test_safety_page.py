"""Sentences of docs/explanation/safety.md that no other test names."""

import importlib
from typing import Any

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError
from haploop.calibration.self_test import examine
from haploop.instruments import RigFile, load_rig_file, open_rig
from haploop.instruments.config.rig_file import AbortLimits, Device
from haploop.instruments.daq.ni_daqmx import NiDaq


def with_relay(**settings: Any) -> RigFile:
    file = load_rig_file("simulated")
    return file.model_copy(update={"relay": Device(**settings)})


def test_doctor_shows_a_box_without_a_timer_in_yellow():
    patches = {"A": 0, "B": 1, "C": 2, "D": 3}
    with open_rig(with_relay(driver="serial-relay", port="COM9", patches=patches, rating=48.0)) as rig:
        (shown,) = [finding for finding in examine(rig) if finding.name == "Dead-man"]
    assert shown.status == "yellow" and "no dead-man timer" in shown.sentence


def test_doctor_shows_a_box_that_may_close_at_power_on_in_red(monkeypatch):
    with open_rig("simulated") as rig:
        complaint = "The channel of patch B may close by itself when the box gets power."
        monkeypatch.setattr(rig.relay, "power_on_complaint", lambda: complaint)
        (shown,) = [finding for finding in examine(rig) if finding.name == "At power-on"]
    assert (shown.status, shown.sentence) == ("red", complaint)


def test_a_card_without_a_number_is_known_by_name_and_server(monkeypatch):
    # Of the modules that have been imported: another test may have imported them anew.
    cards = importlib.import_module("haploop.instruments.daq.ni_cards")
    monkeypatch.setattr(cards, "numbers_of", lambda *_: {"Dev1": ("PCI-6034E 1A",)})
    settings = load_rig_file("haptable").daq.settings
    for server, here in ((None, "this computer"), ("LOCALHOST:31763", "127.0.0.1:31763")):
        named = NiDaq.hardware(NiDaq.Settings.model_validate(settings | {"server": server}))
        assert named == ("PCI-6034E 1A", f"{here} dev2")


def test_a_force_limit_that_a_card_cannot_test_is_an_error_before_anything_is_played():
    file = load_rig_file("simulated").model_copy(update={"abort": AbortLimits(force=20.0)})
    with open_rig(file) as rig:
        with pytest.raises(ConfigurationError, match=r"Dev1 \(PCI-6034E\) converts 200000 samples"):
            rig.excite(np.sin(np.arange(5000) / 30) * np.hanning(5000), ["A"], ["drive"])
        assert rig.simulation.truth.peak == 0
