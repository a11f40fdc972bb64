"""Tests of both roles on the twins, and of the thermometer through its wire."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from haploop_acme_thermometer.microscope import Microscope
from haploop_acme_thermometer.thermometer import AcmeT1, Thermometer

import haploop
from haploop.acquisition import verify
from haploop.base.errors import InstrumentError
from haploop.instruments import RecordedAlong, Rig
from haploop.instruments.rig import rig_schema
from haploop.mocks.transport import DirectLine

SETTINGS = AcmeT1.Settings(port="COM6")
RIG = Path(__file__).parents[1] / "acme.toml"


@pytest.mark.requires("thermometer", "microscope")
def test_the_rig_has_both_and_they_are_typed(rig: Rig) -> None:
    assert rig.role(Thermometer).temperature() == pytest.approx(21, abs=1)
    assert isinstance(rig.role(Microscope), RecordedAlong)


@pytest.mark.requires("simulation")
def test_both_are_recorded_along(rig: Rig, tmp_path: Path) -> None:
    recording = haploop.record(rig, button="push", participant="P01", presses=2, out=tmp_path)
    readings, files = recording.readings, recording.files
    step = recording.rate_hz
    assert [r.sample // step for r in readings] == list(range(int(recording.duration) + 1))
    for r in readings:
        assert (r.instrument, r.name, r.unit) == ("thermometer", "temperature", "°C")
        assert r.value == pytest.approx(21 + r.sample / step / 60, abs=0.02)
    assert len(files) == pytest.approx(2 * recording.duration, abs=2)
    for file in files:
        frame = (tmp_path / file.file).read_bytes()
        assert frame.startswith(b"P5 8 8 255\n")
        assert hashlib.sha256(frame).hexdigest() == file.sha256
    assert verify(recording.path) == ()
    assert recording.extra["humidity"].mean() == pytest.approx(55, abs=0.5)
    assert haploop.acquisition.find_presses(recording)

    (tmp_path / files[0].file).write_bytes(b"another frame")
    (problem,) = verify(recording.path)
    assert files[0].file in problem


@pytest.mark.requires("simulation")
def test_the_same_seed_gives_the_same_recording(open_rig, tmp_path: Path) -> None:
    hashes = []
    for name in ("one", "two"):
        rig = open_rig(seed=3)
        hashes.append(haploop.record(rig, "push", "P01", 1, tmp_path / name).content_hash)
        rig.close()
    assert hashes[0] == hashes[1]


@pytest.mark.requires("simulation")
def test_a_microscope_that_fails_is_an_event_and_costs_no_sample(
    rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    microscope, taken = rig.role(Microscope), []

    def fails_at_times() -> bytes:
        taken.append(len(taken))
        if 2 <= len(taken) <= 4:
            raise InstrumentError("The microscope lost its cable.")
        return b"P5 1 1 255\n0"

    monkeypatch.setattr(microscope, "grab", fails_at_times)
    recording = haploop.record(rig, button="push", participant="P01", presses=1, out=tmp_path)
    (failure,) = [e for e in recording.events if e.kind == "along-error"]
    assert "lost its cable" in failure.text
    assert recording.complete
    assert len(recording.files) == len(taken) - 3
    assert told("show", str(recording.path))["along_errors"][0]["error"] == failure.text


@pytest.mark.requires("simulation")
def test_a_frame_that_exists_is_not_overwritten(rig: Rig, tmp_path: Path) -> None:
    old = tmp_path / "P01-push-frame0001.pgm"
    old.write_bytes(b"precious")
    recording = haploop.record(rig, button="push", participant="P01", presses=1, out=tmp_path)
    assert old.read_bytes() == b"precious"
    assert recording.files[0].file == "P01-push-frame0002.pgm"
    assert not [event for event in recording.events if event.kind == "along-error"]


def told(*arguments: str) -> Any:
    """Run a haploop command and return its JSON output."""
    command = [sys.executable, "-m", "haploop", *arguments, "--json"]
    return json.loads(subprocess.run(command, capture_output=True, check=False).stdout)


def test_the_schema_knows_both() -> None:
    properties = rig_schema()["properties"]
    assert properties["thermometer"]["properties"]["driver"]["enum"] == ["acme-t1"]
    assert "microscope" in properties


@pytest.mark.parametrize("simulate", ["twin", "wire"])
def test_doctor_says_that_they_are_there(simulate: str) -> None:
    findings = told("doctor", "--rig", str(RIG), "--simulate", simulate)["findings"]
    sentences = {finding["instrument"]: finding["sentence"] for finding in findings}
    assert sentences["thermometer"] == "ACME T1 (twin) responds."
    assert sentences["microscope"] == "ACME C1 responds."


@pytest.mark.parametrize("simulate", ["twin", "wire"])
def test_a_scale_unlike_the_rig_files_is_one_sentence(simulate: str, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(f"base = '{RIG}'\n[sensors.extra.humidity]\nchannel = 'humidity'\nscale = 4\nunit = '%'\n")
    expected = (
        "The thermometer of the rig 'acme' reports 40 % per V on the channel 'humidity', and "
        "[sensors.extra.humidity] says 4 % per V: set the instrument, or correct the rig file."
    )
    with pytest.raises(haploop.ConfigurationError) as raised:
        haploop.open_rig(rig, simulate=simulate)
    assert str(raised.value) == expected
    findings = told("doctor", "--rig", str(rig), "--simulate", simulate)["findings"]
    assert [f["sentence"] for f in findings if f["status"] == "red"] == [expected]


@pytest.mark.parametrize("answer", ["", "warm"])
def test_no_answer_is_taken_for_a_temperature_that_is_none(answer: str) -> None:
    def line(asked: str) -> Sequence[str]:
        return ["ACME T1" if asked == "ID" else answer]

    with pytest.raises(InstrumentError, match="'T'"):
        AcmeT1(SETTINGS, DirectLine(line)).temperature()


def test_another_product_is_refused() -> None:
    with pytest.raises(InstrumentError, match="RB-8"):
        AcmeT1(SETTINGS, DirectLine(lambda _asked: ["ACME RB-8"]))
