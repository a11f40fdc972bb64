"""Drift test of a place: lays the active calibration's model over a new response, mode by mode.

Temperature, age, boundaries and amplifier change frequencies, damping and gain; a patch's hysteresis changes
with its temperature and its age. What they do to each button's drive is predicted. A response that no such
change explains means that the table, the patch, or the place that the laser looks at, is not the calibrated
one. The thresholds are the rig file's (`haploop.instruments.config.rig_file.Recalibration`).

An old drive's motion is predicted on a table and a patch as they are now, beside the one they had. The
difference of two predictions is known far better than either: what a model leaves out, and a drive has
learnt, is in both. On a simulated table it agreed with the measured growth of the error within 0.02 of the
target, for hysteresis of 0 to 0.24, drift and damping.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from ...base.filters import fast_length
from ...instruments.config import Recalibration
from ..band import BAND
from ..drive import Drive
from ..model import Calibration, Model
from ..response import Hysteresis, Response
from .overlay import Dampings, Overlay, dampings_of, lay_over

_RING = 0.3
"""Time (s) after a drive in which the table's ringing does not wrap to its beginning."""


def motion_change(
    drive: Drive, before: Calibration, model: Model, hysteresis: Hysteresis, path: float
) -> FloatArray:
    """Change of the motion within the drive's band that one patch makes, (samples,) over the target's norm.

    From the calibration `before` to a table with `model` (relative to the lag of `before`), a patch with
    `hysteresis`, and `path` times the volts at the patch per volt commanded. The norm of the sum over a
    drive's patches is the rms change over the target's rms.
    """
    volts = drive.by_patch[before.response.patch] * float(np.median(np.abs(before.response.path)))
    lag = before.hysteresis.gain(before.response.level)
    then = _acceleration(drive, before.hysteresis.to_linear_volts(volts), before.model, lag)
    now = _acceleration(drive, hysteresis.to_linear_volts(path * volts), model, lag)
    return np.asarray((now - then) / np.linalg.norm(drive.target))


def _acceleration(drive: Drive, linear_volts: FloatArray, model: Model, lag: complex) -> FloatArray:
    """(samples,) m/s^2 within the drive's band."""
    length = fast_length(len(linear_volts) + round(_RING * drive.rate_hz))
    f = np.asarray(np.fft.rfftfreq(length, 1 / drive.rate_hz), dtype=np.float64)
    inside = (f >= drive.band[0]) & (f <= drive.band[1])
    spectrum = np.zeros(len(f), dtype=np.complex128)
    # Without the steps at both ends, hysteresis leaves an offset that would leak into the band.
    slope = np.linspace(linear_volts[0], linear_volts[-1], len(linear_volts))
    driven = np.fft.rfft(linear_volts - slope, length)[inside]
    spectrum[inside] = driven * model.velocity(f[inside]) * 2j * np.pi * f[inside] / lag
    return np.asarray(np.fft.irfft(spectrum, length)[: len(linear_volts)])


Kind = Literal["unchanged", "drifted", "broken"]

_MOST = 0.1
"""Relative shift of a mode that is not weak, beyond which a place counts as broken, not drifted: at the next
grid point of one table the residual was 25 %, and a mode seemed to have moved by 10.5 %."""
_STRANGE = 0.25
"""Residual beyond which table, point or patch differ from the calibrated ones: the next grid points leave 27
to 48 %, or 18 % with half the gain, another patch 52 to 97 %; modes that moved by 3 % each leave 3 to 10 %,
with strengths or dampings that changed by 20 % each 4 to 23 % (measured on four simulated tables)."""
_FACTOR = 1.6
"""Gain factor beyond which a place counts as broken: a patch half off, another range, the laser elsewhere."""
_WEAK = 0.2
"""Amplitude, over that of the measurement, at which the hysteresis is told: about that of a button."""
_OWN = 0.002
"""Shift of a mode beyond the common one, weighted with its strength, from which it is told."""
_STRONG = _OWN / _MOST
"""Weight from which a mode's own shift counts."""
_TOLD = 0.02
"""Change of the gain at small amplitude from which it is told as a change of the hysteresis."""


@dataclass(frozen=True)
class PlaceMetrics:
    """Six metrics of one place, the first three for the mode that is strongest in velocity."""

    resonance_hz: float
    damping: float
    """Ratio to critical."""
    gain: float
    """m/s^2 per V commanded, of the mode above its resonance, where its damping plays no part."""
    coherence: float
    """Median over the band of drives."""
    shape: float
    """Relative rms difference over the band from the fitted model."""
    hysteresis: float
    """Loss of gain of a vibration at a fifth of the level of the measurement, by the patch's hysteresis."""

    @classmethod
    def of(cls, calibration: Calibration) -> PlaceMetrics:
        """Metrics of a calibration, against its own model."""
        f, measured = _in_band(calibration.response)
        model = calibration.model
        residual = measured - model.velocity(f)
        k = _main(model)
        pole, residue = complex(model.poles[k]), complex(model.residues[k])
        return cls(
            resonance_hz=float(abs(pole) / (2 * np.pi)),
            damping=float(-pole.real / abs(pole)),
            gain=float(2 * abs(residue)) * _path(calibration.response),
            coherence=_coherence(calibration.response),
            shape=float(np.linalg.norm(residual) / np.linalg.norm(measured)),
            hysteresis=_loss(calibration.hysteresis, calibration.response.level),
        )


@dataclass(frozen=True)
class ModeShift:
    """How far one mode of a place has moved since it was calibrated."""

    hz: float
    """Its calibrated frequency."""
    shift: float
    """Relative."""


@dataclass(frozen=True)
class Verdict:
    """Result of the drift test of one place. `now` is None when nothing could be measured there."""

    patch: str
    point: str
    kind: Kind
    before: PlaceMetrics
    now: PlaceMetrics | None
    sentences: tuple[str, ...]
    """Findings; for a broken place, the fault and its location."""
    factor: float = 1.0
    """Velocity per volt at the patch, over the calibrated one, that is common to all modes: not a drift of
    theirs, but the laser's scale or the patch's strength."""
    path: float = 1.0
    """Volts at the patch per volt commanded, by the drive monitor, over those when it was calibrated."""
    dampings: Dampings = field(default_factory=Dampings)
    """How the dampings changed, which tells whether something rests on the table."""
    modes: tuple[ModeShift, ...] = ()
    """Of the strong modes in the band of drives, by frequency."""
    changes: Mapping[str, float] = field(default_factory=dict)
    """By button: the predicted change of the motion that its drive makes, over its target."""
    moved: Mapping[str, FloatArray] = field(default_factory=dict)
    """By button: this patch's share in that change, as `motion_change`; `together` adds and removes them."""


def compare(
    active: Calibration,
    response: Response,
    drives: Mapping[str, Drive],
    hysteresis: Hysteresis | None = None,
    thresholds: Recalibration | None = None,
) -> Verdict:
    """Compare a response of the same patch and point with the active calibration.

    `drives` are those of the buttons at this place, by name. `hysteresis` is the law that was found with the
    response; None where none was, and for an active calibration that knows none.
    """
    thresholds = thresholds or Recalibration()
    before = PlaceMetrics.of(active)
    place = f"patch {response.patch} at the {response.point} point"
    f, measured = _in_band(response)
    # One multisine tells the loop, and not the even order: a changed one shows when a button is played.
    law = replace(hysteresis, even=active.hysteresis.even) if hysteresis else active.hysteresis
    lag = active.hysteresis.gain(active.response.level)
    laid = lay_over(active.model, f, np.asarray(measured * lag / law.gain(response.level)))
    # The response is from the volts at the patch; a drive is commanded.
    path = _path(response) / _path(active.response)
    k = _main(active.model)
    shift, damping, gain = float(laid.shift[k]), float(laid.damping[k] - 1), laid.gain * path - 1
    now = PlaceMetrics(
        resonance_hz=before.resonance_hz * (1 + shift),
        damping=before.damping * (1 + damping),
        gain=before.gain * (1 + gain),
        coherence=_coherence(response),
        shape=laid.residual,
        hysteresis=_loss(law, response.level if hysteresis else active.response.level),
    )
    moved = {name: motion_change(drive, active, laid.model, law, path) for name, drive in drives.items()}
    # What several patches make together is only known once all were measured: see `together`.
    alone = {name: change for name, change in moved.items() if len(drives[name].patches) == 1}
    changes = {name: float(np.linalg.norm(change)) for name, change in alone.items()}

    verdict = Verdict(
        response.patch,
        response.point,
        "broken",
        before,
        now,
        (),
        factor=laid.factor,
        path=path,
        dampings=dampings_of(active.model, laid),
        modes=_shifts(active.model, laid),
        changes=changes,
        moved=moved,
    )
    if broken := _broken(verdict, laid, thresholds):
        return replace(verdict, sentences=(broken,))
    told = [
        f"The {name} of {place} changed by {change:+.{digits}%}, and {limit:.{digits}%} is accepted."
        for name, change, limit, digits in (
            ("resonance", shift, thresholds.resonance, 2),
            ("damping", damping, thresholds.damping, 0),
            ("gain", gain, thresholds.gain, 1),
        )
        if abs(change) > limit
    ]
    if laid.residual > before.shape + thresholds.shape:
        told.append(
            f"The response of {place} differs by {laid.residual:.0%} from the calibrated one in a way that "
            f"no drift of its modes explains; it was {before.shape:.1%}, and "
            f"{thresholds.shape:.0%} more is accepted."
        )
    affected = {name: change for name, change in changes.items() if change > thresholds.change}
    if affected:
        told.append(_changed(affected, place, thresholds))
    if told:
        return replace(verdict, kind="drifted", sentences=(*told, *_causes(laid, shift, before, now, place)))
    still = f"The resonance of {place} is at {now.resonance_hz:.2f} Hz ({shift:+z.2%})."
    return replace(verdict, kind="unchanged", sentences=(still,))


def _broken(verdict: Verdict, laid: Overlay, thresholds: Recalibration) -> str:
    """A sentence on why a place is broken and what to look at; empty where it can only have drifted."""
    before, now, place = verdict.before, verdict.now, f"patch {verdict.patch} at the {verdict.point} point"
    assert now is not None
    if not now.coherence >= thresholds.coherence:
        return (
            f"The {verdict.point} point does not follow patch {verdict.patch}: the coherence is "
            f"{now.coherence:.2f}, it was {before.coherence:.2f}, and {thresholds.coherence:g} is needed."
        )
    if laid.residual > _STRANGE:
        return (
            f"The response of {place} is not the calibrated one (no drift explains {laid.residual:.0%} of "
            "it): check that the laser still looks at the point, and the patch's glue and wires."
        )
    gain = laid.gain * verdict.path
    if not 1 / _FACTOR < gain < _FACTOR:
        return (
            f"The gain of {place} is {gain:.2f} times what it was, which is no drift: check the "
            "patch, the vibrometer's range, and the laser's aim and focus."
        )
    strong = laid.shift[laid.weight > _STRONG]
    if float(np.abs(strong).max()) > _MOST:
        return (
            f"The modes of {place} would have moved by {strong.min():+.1%} to {strong.max():+.1%}, and more "
            f"than {_MOST:.0%} is no drift: check that the laser still looks at the point, and the table."
        )
    return ""


def together(
    verdicts: Sequence[Verdict], drives: Mapping[str, Drive], thresholds: Recalibration
) -> list[Verdict]:
    """The verdicts with what drives of several patches make of all changes, where all patches were measured.

    The change of one patch's share says nothing: such drives are planned so that a drift cancels in the sum.
    """
    found = list(verdicts)
    for name, drive in drives.items():
        own = [k for k, v in enumerate(found) if name in v.moved]
        if len(drive.patches) == 1 or len(own) < len(drive.patches):
            continue
        change = float(np.linalg.norm(np.sum([found[k].moved[name] for k in own], axis=0)))
        for k in own:
            found[k] = replace(found[k], changes={**found[k].changes, name: change})
        last = found[own[-1]]
        if change > thresholds.change and last.kind != "broken":
            kept = last.sentences if last.kind == "drifted" else ()
            told = _changed({name: change}, f"patches {drive.patch} at the {drive.point} point", thresholds)
            found[own[-1]] = replace(last, kind="drifted", sentences=(*kept, told))
    return [replace(verdict, moved={}) for verdict in found]


def _changed(affected: Mapping[str, float], place: str, thresholds: Recalibration) -> str:
    names = ", ".join(f"{name} by {change:.0%}" for name, change in affected.items())
    return (
        f"On {place} as it is now, old drives make another motion: {names} of the target, and "
        f"{thresholds.change:.0%} is accepted."
    )


def _causes(laid: Overlay, shift: float, before: PlaceMetrics, now: PlaceMetrics, place: str) -> list[str]:
    """Sentences on modes that moved on their own, and on the hysteresis."""
    causes = []
    strong = laid.weight > _STRONG
    own = np.where(strong, laid.shift, shift)
    if float((np.abs(own - shift) * laid.weight).max()) > _OWN:
        causes.append(
            f"The modes of {place} moved each on its own, by {own.min():+.2%} to {own.max():+.2%}: look for "
            "a boundary that gave way, or for something that touches the table."
        )
    if abs(now.hysteresis - before.hysteresis) > _TOLD:
        causes.append(
            f"The patch's hysteresis changed: at a fifth of the voltage the table moves "
            f"{now.hysteresis:.0%} less per volt than at the full one, and it was {before.hysteresis:.0%}."
        )
    return causes


def _in_band(response: Response) -> tuple[FloatArray, ComplexArray]:
    inside = (response.frequencies >= BAND[0]) & (response.frequencies <= BAND[1])
    return response.frequencies[inside], response.velocity[inside]


def _coherence(response: Response) -> float:
    inside = (response.frequencies >= BAND[0]) & (response.frequencies <= BAND[1])
    return float(np.median(response.coherence[inside]))


def _path(response: Response) -> float:
    """Volts at the patch per volt commanded."""
    return float(np.median(np.abs(response.path)))


def _shifts(model: Model, laid: Overlay) -> tuple[ModeShift, ...]:
    hz = np.abs(model.poles) / (2 * np.pi)
    strong = (model.poles.imag > 0) & (laid.weight > _STRONG) & (hz >= BAND[0]) & (hz <= BAND[1])
    order = [int(k) for k in np.argsort(hz) if strong[k]]
    return tuple(ModeShift(float(hz[k]), float(laid.shift[k])) for k in order)


def _main(model: Model) -> int:
    """Number of the pole of the resonance that is strongest in velocity."""
    return int(np.argmin(np.abs(np.abs(model.poles) / (2 * np.pi) - model.resonance_hz)))


def _loss(law: Hysteresis, level: float) -> float:
    return 1 - abs(law.gain(_WEAK * level)) / abs(law.gain(level))
