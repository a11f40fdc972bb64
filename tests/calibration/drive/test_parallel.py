"""Patches in parallel on one amplifier channel: what a plan says, beside tables on which they are one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from haploop.calibration import ButtonPlan, Calibration, Multisine, Trade, calibrate, drive_for, plan_button
from haploop.calibration.drive.actuation import Actuation
from haploop.calibration.drive.parallel import COMPARED_AT, Wired, Wiring, parallel_wirings
from haploop.instruments import Limits, Rig, RigFile, open_rig
from haploop.mocks.plant.hysteresis import Hysteresis
from haploop.mocks.plant.modal_surface import ModalSurface
from haploop.mocks.plant.table import TouchTable, make_plate
from haploop.reports.contents import contents_of
from tests.calibration.conftest import make_press

pytestmark = pytest.mark.long

WIDTHS = {"A": 0.12, "B": 0.09, "C": 0.15, "D": 0.11}


class Joined(TouchTable):
    """A table whose patch A is `signs` times the patches, wired in parallel."""

    signs: tuple[float, float] = (1.0, 0.0)

    def make(self, file: RigFile, rng: np.random.Generator) -> ModalSurface:
        plate = make_plate(rng)
        first = self.signs[0] * plate.coupling["A"] + self.signs[1] * plate.coupling["C"]
        return ModalSurface(replace(plate, coupling={**plate.coupling, "A": first}))

    def law(self, patch: str, file: RigFile) -> Hysteresis:
        return Hysteresis(WIDTHS[patch])


def opened(*signs: float) -> Rig:
    plant = Joined(signs=signs) if signs else Joined()
    return open_rig("simulated", simulate="twin", simulation={"seed": 811}, plant=plant)


@pytest.fixture(scope="module")
def rig() -> Iterator[Rig]:
    with opened() as rig:
        yield rig


@pytest.fixture(scope="module")
def calibrations(rig: Rig) -> list[Calibration]:
    return [calibrate(rig, patch, excitation=Multisine()) for patch in "ABCD"]


@pytest.fixture(scope="module")
def wired(rig: Rig, calibrations: list[Calibration]) -> dict[Wiring, Wired]:
    pair = [calibrations[0], calibrations[2]]
    found = parallel_wirings(make_press(), pair, rig.limits_for, "modulated")
    reverse = parallel_wirings(make_press(), [pair[0], turned(pair[1])], rig.limits_for, "modulated")
    return {one.wiring: one for one in (*found, replace(reverse[0], wiring=Wiring(("A", "C"), ("C",))))}


def turned(calibration: Calibration) -> Calibration:
    """The same patch with its wires swapped."""
    response, model = calibration.response, calibration.model
    assert calibration.above is not None
    return replace(
        calibration,
        response=replace(response, velocity=-response.velocity),
        model=replace(model, residues=-model.residues, constant=-model.constant, slope=-model.slope),
        above=replace(calibration.above, velocity=-calibration.above.velocity),
    )


@pytest.mark.parametrize("swapped", [(), ("C",)])
def test_a_wiring_plays_what_a_table_plays_on_which_it_is_one_patch(
    rig: Rig,
    calibrations: list[Calibration],
    wired: dict[Wiring, Wired],
    swapped: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # As one patch they would have another strongest resonance, and play another target.
    monkeypatch.setattr(Calibration, "carrier_hz", Actuation.of(calibrations).carriers[0])
    told = wired[Wiring(("A", "C"), swapped)]
    with opened(1.0, -1.0 if swapped else 1.0) as joined:
        one = calibrate(joined, "A", excitation=Multisine())
        drive = drive_for(make_press(), one, rig.limits_for(2), trade=Trade(COMPARED_AT))
    assert told.scale == pytest.approx(drive.scale, rel=0.1)
    assert told.peak == pytest.approx(drive.peak, rel=0.03)


def test_the_loudest_wirings_are_found_and_the_channel_drives_the_load_of_all(
    rig: Rig, calibrations: list[Calibration]
) -> None:
    found = parallel_wirings(make_press(), calibrations, rig.limits_for, "modulated")
    every, as_wired, best = found
    assert every.wiring == Wiring(tuple("ABCD")) and not as_wired.wiring.reversed and best.wiring.reversed
    assert every.louder < as_wired.louder < best.louder
    asked = []

    def weak(patches: int) -> Limits:
        asked.append(patches)
        own = rig.limits_for(patches)
        return replace(own, current_peak=4e-4) if patches > 2 else own

    weaker = parallel_wirings(make_press(), calibrations, weak, "modulated")
    assert {1, 2, 3, 4} <= set(asked)
    assert weaker[0].scale < 0.5 * every.scale and len(weaker[-1].wiring.patches) == 2


def test_a_plan_says_it_where_one_channel_drives_all(
    rig: Rig, calibrations: list[Calibration], tmp_path: Path
) -> None:
    plan = plan_button(make_press(), calibrations, rig, methods=("modulated",))
    assert [curve.patch for curve in plan.curves] == ["A"] and len(plan.parallel) == 3
    plan.save(tmp_path / "plan.h5")
    assert ButtonPlan.load(tmp_path / "plan.h5").parallel == plan.parallel
    contents = contents_of(plan)
    [said] = [note for note in contents.notes if "in parallel" in note.lower()]
    assert "A, B, C, D as wired would be 0." in said and "swapped" in said
    assert contents.values["parallel"][0]["patches"] == ["A", "B", "C", "D"]
    alone = plan_button(make_press(), calibrations[:1], rig, methods=("modulated",))
    assert not alone.parallel and "parallel" not in " ".join(contents_of(alone).notes)
