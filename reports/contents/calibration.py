"""What a calibration, its waveforms and a drive say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from ...calibration import Drift, drift_change
from ...calibration.band import BAND
from .. import figures
from . import words
from .parts import Contents, Drawing, Fact, Grid, Verdict, detailed, fact
from .words import damping, percent, sentence

if TYPE_CHECKING:
    from ...calibration import Calibration, Drive, Model, Resonance, Waveforms

_TOLD, _MOST = 0.01, 5
"""Share of the motion from which the background's tones are told, and the most of a kind."""
_RINGS = 0.02
"""Relative distance from a resonance up to which what sounds in a rest may be the resonance."""


def _finger(calibration: Calibration) -> list[Fact]:
    """The fingertip under which a calibration holds; nothing for the bare table."""
    finger = calibration.finger
    if finger is None:
        return []
    beside = f", seen at {', '.join(finger.beside)}" if finger.beside else ""
    beside += ", by a map" if finger.mapped else ""
    return [
        fact(
            "Under a finger",
            f"{finger.participant}, {finger.force:g} N{beside}: it changes the response by "
            f"{percent(finger.changed)}, known to {percent(finger.uncertainty)}",
            finger=finger.participant,
            finger_force=finger.force,
            finger_beside=finger.beside,
            finger_changed=finger.changed,
            finger_misfit=finger.misfit,
            finger_uncertainty=finger.uncertainty,
            finger_mapped=finger.mapped,
            carrier_hz=calibration.carrier_hz,
        )
    ]


def calibration_contents(calibration: Calibration) -> Contents:
    """What a calibration says: the measured response, and the model that was fitted to it."""
    response, model = calibration.response, calibration.model
    patch, point, repeats = response.patch, response.point, response.repeats
    low, high = response.frequencies[[0, -1]]
    radius, known = response.confidence(), response.coherence
    lowest, median = (float(known.min()), float(np.median(known))) if known.size else (None, None)
    coherence = "not measured" if lowest is None else f"median {median:.4f}, lowest {lowest:.4f}"
    relative = np.median(radius) / np.abs(response.velocity).max() if radius.size else None
    stable = bool(model.stable)
    facts = [
        fact("Rig", f"{response.rig}, {response.created}", rig=response.rig, created=response.created),
        fact(
            "Response",
            f"{low:.0f} to {high:.0f} Hz, {repeats} repeats",
            band_hz=(low, high),
            repeats=repeats,
            patch=patch,
            point=point,
            confidence=relative,
        ),
        *_finger(calibration),
        fact("Excitation", response.excitation, excitation=response.excitation),
        fact("Source", response.source if response.source != "measured" else "", source=response.source),
        fact("Coherence", coherence, coherence_min=lowest, coherence_median=median),
        fact(
            "Resonance",
            f"{model.resonance_hz:.2f} Hz (the strongest of {len(model.resonances)}"
            f"{'' if _in_band(_strongest(model)) else ', in the band of drives'})",
            resonance_hz=model.resonance_hz,
            resonances=[_resonance(one) for one in model.resonances],
        ),
        fact("Damping ratio", damping(model.carriers[0])),
        *_carrier(calibration),
        *_background(calibration),
        fact(
            "Model",
            f"{percent(model.error)} from the response, {'stable' if stable else 'UNSTABLE'}",
            model_error=model.error,
            stable=stable,
        ),
        *detailed([channel_fact([calibration]), drift_fact([calibration])]),
    ]
    verdict = Verdict(
        f"Calibration, patch {patch} at {point}",
        "stable" if stable else "unstable",
        stable,
        f"model {percent(model.error)} from the response; coherence "
        f"{'not measured' if lowest is None else f'at least {lowest:.3f}'}",
    )
    return Contents(
        f"Calibration of patch {patch} at the {point} point",
        facts,
        [_resonances(calibration)],
        kind="calibration",
        simulated=response.simulated,
        rig=response.rig,
        verdicts=[verdict],
        figures=[response_drawing(calibration)],
    )


def _carrier(calibration: Calibration) -> Iterator[Fact]:
    """What carries presses, where that is not simply the strongest resonance, and what it costs."""
    bare, strongest, why = calibration.bare, _strongest(calibration.bare), ""
    if calibration.chosen_hz:
        why = f"as asked; the strongest resonance is {strongest:.2f} Hz"
    elif not _in_band(strongest):
        low, high = BAND
        why = f"not {strongest:.2f} Hz, which lies outside the band of drives ({low:g} to {high:g} Hz)"
    carriers, chosen = [one.frequency_hz for one in bare.carriers], calibration.chosen_hz or None
    if not why:
        yield fact("Carrier", bare.ambiguity, carriers_hz=carriers, carrier_chosen_hz=chosen)
        return
    moved, felt = calibration.quieter_than(strongest)
    yield fact(
        "Carrier",
        f"{calibration.carrier_hz:.2f} Hz, {why}: at the same volts it moves the table {_fewer(moved)} and "
        f"is felt {_fewer(felt)} than that",
        carriers_hz=carriers,
        carrier_chosen_hz=chosen,
        carrier_costs_db=(moved, felt),
    )


def _strongest(model: Model) -> float:
    """Resonance (Hz) with the largest velocity, in whatever band."""
    hz = np.array([one.frequency_hz for one in model.resonances])
    return float(hz[np.argmax(np.abs(model.velocity(hz)))])


def _in_band(hz: float) -> bool:
    return BAND[0] < hz < BAND[1]


def _fewer(decibels: float) -> str:
    return f"{abs(decibels):.1f} dB {'less' if decibels >= 0 else 'more'}"


def _background(calibration: Calibration) -> Iterator[Fact]:
    """The background's tones, as a check names them. What is not steady and at a resonance may ring."""
    tones = calibration.response.tones
    rings = np.array([one.frequency_hz for one in calibration.model.resonances])
    apart = np.all(np.abs(tones.unsteady[:, None] / rings - 1) > _RINGS, axis=1)
    said = []
    for hz, share, what in (
        (tones.steady, tones.steady_share, "steady tones at {} Hz, which were taken out"),
        (
            tones.unsteady[apart],
            tones.unsteady_share[apart],
            "tones at {} Hz that are not steady and stay in",
        ),
    ):
        told = np.sort(hz[share > _TOLD][np.argsort(-share[share > _TOLD])][:_MOST])
        if len(told):
            said.append(what.format(", ".join(f"{one:.1f}" for one in told)))
    yield fact(
        "Background",
        f"{'; '.join(said)}: look for mains hum (ground the laser's cable), a fan or a motor" if said else "",
        tones_hz=tones.steady,
        tones_unsteady_hz=tones.unsteady[apart],
    )


def _resonances(calibration: Calibration) -> Grid:
    """The resonances of the model, each with its residue as the peak of its pole pair."""
    response, rows = calibration.response, []
    for one in calibration.model.resonances:
        rows.append((f"{one.frequency_hz:.2f} Hz", damping(one), f"{1e6 * one.strength:.3g} µm/s"))
    title = f"Resonances of patch {response.patch} at the {response.point} point"
    return Grid(title, ("Frequency", "Damping ratio (95 %)", "Residue, as its peak per volt"), rows)


def _resonance(one: Resonance) -> dict[str, Any]:
    return {
        "frequency_hz": one.frequency_hz,
        "damping": one.damping,
        "damping_interval": one.damping_interval,
        "damping_is_bound": one.damping_is_bound,
        "strength": one.strength,
    }


def response_drawing(calibration: Calibration) -> Drawing:
    """The figure of a measured response and its model."""
    response = calibration.response
    return Drawing(
        "response",
        f"Response of patch {response.patch} at the {response.point} point",
        words.RESPONSE,
        [calibration],
        lambda some, columns: figures.response(some[0], columns=columns),
        lambda _: f"n = {response.repeats} repeats ({response.excitation}), {response.created}.",
        identity=(response.rig, response.patch, response.point, response.created),
        several=1,
    )


def calibrations_contents(calibrations: Sequence[Calibration]) -> Contents:
    """What calibrations of several patches say together."""
    first = calibrations[0].response
    facts = [fact("Rig", f"{first.rig}, {first.created}", rig=first.rig, created=first.created)]
    for one in calibrations:
        response, model = one.response, one.model
        facts.append(
            fact(
                f"Patch {response.patch}",
                f"resonance {model.resonance_hz:.2f} Hz, model {percent(model.error)} from the response",
                **{
                    f"patch_{response.patch}": {
                        "resonance_hz": model.resonance_hz,
                        "model_error": model.error,
                        "stable": bool(model.stable),
                    }
                },
            )
        )
    facts += [channel_fact(calibrations), drift_fact(calibrations)]
    patches = ", ".join(one.response.patch for one in calibrations)
    return Contents(
        f"Calibrations of patches {patches} at the {first.point} point",
        facts,
        kind="calibrations",
        simulated=first.simulated,
        rig=first.rig,
    )


def channel_fact(calibrations: Sequence[Calibration]) -> Fact:
    """How the channels' gains and delays scatter, of which drives of several patches are planned."""
    widest = max((one.scatter for one in calibrations), key=lambda one: one.gain)
    how = f"{widest.changes} changes within {widest.seconds / 3600:.1f} h" if widest.changes else "estimates"
    return fact(
        "Channel",
        f"scatters by {percent(widest.gain, 2)} of gain and {1e6 * widest.delay:.2g} µs of delay ({how})",
        channel=asdict(widest),
    )


def drift_fact(calibrations: Sequence[Calibration]) -> Fact:
    """What the drift that drives are planned against does to the responses."""
    drift = Drift()
    change = drift_change(calibrations, drift)
    return fact(
        "Drift",
        f"{drift.common:.1%} of all resonances, {drift.own:.1%} of each, and {drift.damping:.0%} of its "
        f"damping change the response by {change:.0%}; drives of several patches are planned against it",
        drift=asdict(drift),
        drift_change=change,
    )


def drive_contents(drive: Drive) -> Contents:
    """What a drive says."""
    return Contents(
        f"Drive of the {drive.button} button at patch {drive.patch}",
        list(drive_facts(drive)),
        kind="drive",
        simulated=drive.simulated,
        rig=drive.rig,
        figures=[drive_drawing(drive)],
    )


def drive_facts(drive: Drive) -> Iterator[Fact]:
    """The voltage of a drive, how it was computed, and how much of the press it reaches."""
    low, high = drive.band
    peak_to_peak, duration = float(np.ptp(drive.volts, axis=1).max()), len(drive.target) / drive.rate_hz
    yield fact(
        "Drive",
        f"{drive.peak:.1f} V peak, {peak_to_peak:.1f} V peak to peak at patch {drive.patch}",
        drive_peak_v=drive.peak,
        drive_peak_to_peak_v=peak_to_peak,
        button=drive.button,
        patch=drive.patch,
    )
    length = f"{1e3 * duration:.0f} ms at {drive.rate_hz:g} Hz"
    yield from detailed([fact("Length", length, duration_s=duration, rate_hz=drive.rate_hz)])
    carrier = f", with {drive.carrier_hz:.2f} Hz" if drive.carrier_hz else ""
    yield fact("Method", f"{drive.method}{carrier}", method=drive.method, carrier_hz=drive.carrier_hz)
    yield fact(
        "Band",
        f"{low:.0f} to {high:.0f} Hz, {percent(drive.in_band)} of the energy",
        band_hz=drive.band,
        in_band=drive.in_band,
    )
    yield fact("Scale", f"{drive.scale:.4f} of the recorded acceleration", scale=drive.scale)
    for one in drive.elsewhere:
        carrier = f", with {one.carrier_hz:.2f} Hz" if one.carrier_hz else ""
        scale = f"{one.scale:.4f} of the recorded acceleration"
        yield fact(f"At point {one.point}", f"{one.button}, {scale}{carrier}" if one.button else "silence")
    predicted = percent(drive.predicted_error)
    planned = drive.drift if drive.drift.modes else Drift()
    unplanned = "" if drive.drift.modes else ", which it was not planned against"
    yield from detailed(
        [
            fact("Predicted error", predicted, predicted_error=drive.predicted_error),
            fact(
                "After a drift",
                f"{percent(drive.drifted_error)} when the table drifts by {planned.common:.1%}{unplanned}",
                drifted_error=drive.drifted_error,
                drift=asdict(drive.drift),
            ),
            fact("Not reached", drive.unreached, unreached=drive.unreached),
        ]
    )


def drive_drawing(drive: Drive) -> Drawing:
    """The figure of a drive."""
    return Drawing(
        "drives",
        "Drives",
        words.DRIVES,
        [drive],
        lambda some, columns: figures.drives(some, columns=columns),
        lambda some: sentence(
            [f"{one.button}, {one.method}, {one.band[0]:.0f} to {one.band[1]:.0f} Hz" for one in some]
        ),
        identity=(drive.button, drive.patch, drive.volts.tobytes()),
    )


def waveforms_contents(waveforms: Waveforms) -> Contents:
    """What the waveforms of a calibration say."""
    captures = waveforms.captures
    channels = sorted({channel for capture in captures for channel in capture.channels})
    facts = [
        fact(patch=waveforms.patch, point=waveforms.point),
        fact(
            "Plays",
            f"{len(captures)}, {waveforms.seconds:.1f} s in all",
            plays=len(captures),
            seconds=waveforms.seconds,
            rate_hz=captures[0].rate_hz if captures else None,
        ),
        fact("Channels", ", ".join(channels), channels=channels),
        fact("Calibration", f"SHA-256 {waveforms.calibration}", calibration=waveforms.calibration),
    ]
    return Contents(
        f"Waveforms of a calibration of patch {waveforms.patch}, {waveforms.point} point",
        facts,
        kind="waveforms",
        simulated=waveforms.simulated,
        undrawn="There is no plot of waveforms: plot the calibration that they belong to.",
    )
