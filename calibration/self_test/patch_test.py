"""Test that each patch moves the table and that the relay's channels connect the right patches.

Short sweeps of a few volts go into each patch, and the laser measures near the place of each patch.
A collocated response is in phase: every mode that a patch drives moves the patch's own place in the
same direction. At another place some modes move in the opposite direction. So the in-phase part of the
response, summed over the band, S(place, patch), obeys S(p, q)^2 < S(p, p) S(q, q), whatever the
strength of each patch, and the true pairing of places with channels has the largest product of all S.
(The largest amplitude is not sufficient: a strong patch exceeds a weak one at the weak one's place, and
two mirrored patches have the same amplitude in every mode.)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...base.arrays import BoolArray, ComplexArray, FloatArray
from ...base.errors import HaploopError, InstrumentError
from ...instruments import Capture, Rig
from ...instruments.rig import UnshownError
from ...instruments.vibrometer import shown as shown_as
from ..response import LinearSweep, capture_sweep, linear_sweep, ordered
from .finding import Finding

_LEVEL = 10.0
"""V at the patch."""
_ALLOWED, _WEAKEST = 0.98, 0.01
"""Share of what limits of current and heat allow, and the weakest sweep (V) that is tried on a coil."""
_DURATION, _TAIL = 0.3, 0.15
_STOP_HZ = 625.0
_SWEEP = LinearSweep(stop_hz=_STOP_HZ, seconds=_DURATION, tail=_TAIL)
"""The same of a generator."""
_BAND = (30.0, 610.0)
_SEEN = 3.0
"""Velocity, over the noise of the same measurement without a drive, above which a patch moves the table."""
_REACHED, _CLOSED = 0.3, 0.1
"""V measured per V commanded: above the first, a drive reaches its patch; above the second, with all
channels open, a contact is closed. An amplifier with a wrong gain can lie between them."""
_GAIN = 0.1
"""Accepted relative error of the measured drive: two amplifiers of one type differ by 1 %
(docs/hardware.md, "Amplifier")."""
_CLEAR = 1.3
"""Product of the best pairing over that of the rig file's, above which the finding is certain."""


@dataclass(frozen=True)
class _Answer:
    """Result of one sweep, per volt commanded: `drive` V at the patch, `seen` m/s (rms over the band),
    `in_phase` m/s (in phase with the drive). `problem` is a sentence about a signal out of range, and
    `elsewhere` are the monitors of other patches that show the drive.
    """

    drive: float
    seen: float = 0.0
    in_phase: float = 0.0
    problem: str | None = None
    elsewhere: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Answers:
    """Answers by (place, patch), the answer to silence, and the patches that could not be played."""

    level: float
    of: dict[tuple[str, str], _Answer]
    silence: _Answer
    refused: dict[str, str]
    alone: bool
    """Whether each patch has a channel of the amplifier of its own."""

    def best(self) -> dict[str, _Answer]:
        """The strongest answer to each patch, over all places."""
        best: dict[str, _Answer] = {}
        for (_, patch), answer in self.of.items():
            if patch not in self.refused and (patch not in best or answer.seen > best[patch].seen):
                best[patch] = answer
        return best


def check_patches(rig: Rig) -> Iterator[Finding]:
    """Run the tests of this module. Raises InstrumentError when nobody aims or an instrument fails."""
    answers = _measure(rig)
    for patch, sentence in answers.refused.items():
        yield Finding(f"Patch {patch}", "table", "red", sentence)
    yield from _drive_findings(answers)
    driven = {p: a for p, a in answers.best().items() if abs(a.drive) > _REACHED}
    if not driven or abs(answers.silence.drive) > _CLOSED:
        return
    seen = {p for p, a in driven.items() if a.seen > _SEEN * answers.silence.seen}
    blind = next((a.problem for a in answers.of.values() if a.problem), None)
    if not blind and not seen:
        blind = (
            f"It saw none of the {len(driven)} patches, each driven with {answers.level:g} V: is the beam "
            "blocked, out of focus or beside the table, or its cable off?"
        )
    if blind:
        yield Finding("Laser", "vibrometer", "red", blind)
        return
    for patch, answer in driven.items():
        moved = f"{answer.seen * 1e6:.2g} µm/s per V"
        if patch in seen:
            times = answer.seen / answers.silence.seen
            sentence = f"The patch moves the table: {moved}, {times:.0f} times the noise."
            yield Finding(f"Patch {patch}", "table", "green", sentence)
        else:
            sentence = (
                f"{answers.level:g} V reach the wires of this patch, but the laser measures only noise "
                f"({moved}); other patches do move the table: the patch is dead. Check its solder joints "
                "and glue, or replace it."
            )
            yield Finding(f"Patch {patch}", "table", "red", sentence)
    known = [p for p in rig.table.patch_places if p in seen]
    if rig.file.relay is None:
        return
    yield _wiring({k: a.in_phase for k, a in answers.of.items()}, known)


def _measure(rig: Rig) -> _Answers:
    places = rig.table.patch_places
    patches = [p for p in rig.table.patches if p in rig.relay.patches]
    known = [p for p in patches if p in places]
    points = {p: str(rig.table.nearest(places[p])) for p in known} if len(known) > 1 else {"": "button"}
    rate_hz, level = rig.table.rate_hz, min(_LEVEL, rig.limits.peak)
    factor, _ = rig.limits.headroom(linear_sweep(rate_hz, _DURATION, _STOP_HZ, level), rate_hz)
    level *= min(1.0, _ALLOWED * factor) if factor < 1 else 1.0
    by_generator = rig.feeds_amplifier("generator")
    one = ordered(_SWEEP, rate_hz) if by_generator else linear_sweep(rate_hz, _DURATION, _STOP_HZ, 1.0)
    sweep = level * one
    # A player's latency is found from its drive on the monitor, but open channels show none: play silence. So
    # without a relay, where nothing is open.
    silent = rig.file.player is not None or rig.file.relay is None
    of: dict[tuple[str, str], _Answer] = {}
    refused: dict[str, str] = {}
    silence: _Answer | None = None
    for place, point in points.items():
        if not rig.operator.confirm(rig.aim(point)):
            raise InstrumentError(
                f"The operator did not confirm this request, so no patch was tested: {rig.aim(point)}"
            )
        silence = silence or _play(rig, sweep, silent=silent)
        for patch in (p for p in patches if p not in refused):
            try:
                of[place, patch] = _play(rig, sweep, patch)
                while of[place, patch].problem and rig.actuator.kind == "coil" and level > _WEAKEST:
                    # A coil may move the table much more than a patch does, and how much is not known yet.
                    level, sweep = level / 4, sweep / 4
                    of[place, patch] = _play(rig, sweep, patch)
            except UnshownError as error:
                of[place, patch] = _Answer(error.share, elsewhere=error.elsewhere)
            except HaploopError as error:
                if rig.lockout is not None:
                    raise  # nothing is played any more
                refused[patch] = str(error)
    assert silence is not None, "there is a point"
    return _Answers(level, of, silence, refused, bool(rig.amplifier.inputs))


def _play(rig: Rig, sweep: FloatArray, patch: str = "", silent: bool = False) -> _Answer:
    """Play the sweep, into `patch` or into open contacts, or silence as long, and measure the answer.

    Of open contacts the drive is that of the monitor which shows most.
    """
    sensor = rig.sensors.drive
    assert sensor is not None
    channels, played = sensor.channels, 0 * sweep if silent else sweep
    # The patch's own monitor first: by it a generator's sweep is found.
    first = rig.monitor(patch) if patch else channels[0]
    channels = (first, *(one for one in channels if one != first))
    recorded, into = (*channels, rig.vibrometer.channel), (patch,) if patch else ()
    if not rig.feeds_amplifier("generator"):
        capture = rig.excite(played, into, recorded, _TAIL)
    elif silent:
        capture = rig.daq.captured(recorded, rig.table.rate_hz, _DURATION + _TAIL)
    else:
        capture, start, _ = capture_sweep(rig, _SWEEP, float(np.abs(sweep).max()), into, recorded)
        capture = replace(capture, volts=capture.volts[:, max(start, 0) :])
    samples, rate_hz = capture.volts.shape[1], capture.rate_hz
    f = np.asarray(np.fft.rfftfreq(samples, 1 / rate_hz), dtype=np.float64)
    inside = (f > _BAND[0]) & (f < _BAND[1])
    f = np.asarray(f[inside])
    commanded = _spectrum(sweep, samples, inside)
    # The laser's delay, and those of the card's channels, rotate the phase: they are removed. A delta-sigma
    # input's filter alone turns it several times within the band.
    skew = np.exp(-2j * np.pi * f * capture.delays[:, None])
    velocity = _spectrum(rig.vibrometer.to_si(capture.volts[-1]), samples, inside) * skew[-1]
    velocity = np.asarray(velocity / rig.motion_response(f))
    power = float((np.abs(commanded) ** 2).sum())

    def shown(row: int) -> float:
        """Volts that a monitor shows, per volt commanded."""
        drive = _spectrum(sensor.to_si(capture.volts[:-1])[row], samples, inside) * skew[row]
        drive = np.asarray(drive / rig.daq.response(channels[row], f))
        return float((drive * commanded.conj()).real.sum() / power)

    drives = {channel: shown(row) for row, channel in enumerate(channels)}
    strongest = max(drives, key=lambda channel: abs(drives[channel]))
    own = rig.monitor(patch) if patch else strongest
    return _Answer(
        drive=drives[own],
        seen=float(np.sqrt((np.abs(velocity) ** 2).sum() / power)),
        in_phase=float((velocity * commanded.conj()).real.sum() / power),
        problem=_overload(rig, capture),
        elsewhere=tuple(c for c, drive in drives.items() if c != own and abs(drive) > _REACHED),
    )


def _spectrum(signal: FloatArray, samples: int, inside: BoolArray) -> ComplexArray:
    return np.asarray(np.fft.rfft(signal - signal.mean(), samples)[inside])


def _overload(rig: Rig, capture: Capture) -> str | None:
    fastest = float(np.abs(rig.vibrometer.to_si(capture.volts[-1])).max())
    if capture.overload[-1] or fastest > rig.vibrometer.range:
        return (
            f"The {rig.vibrometer.quantity} reached the end of the "
            f"{shown_as(rig.vibrometer.quantity, rig.vibrometer.range)} range at {_LEVEL:g} V: "
            "there is too little light (focus the laser, or use reflective tape), or the range is too small."
        )
    if capture.overload[:-1].any():
        return "The drive monitor left its input range: increase the range of its channel in the rig file."
    return None


def _drive_findings(answers: _Answers) -> Iterator[Finding]:
    """Findings from the drive monitor: the amplifier's gain, and contacts that do not switch."""
    best, silence, level = answers.best(), answers.silence, answers.level
    if abs(silence.drive) > _CLOSED:
        sentence = (
            f"With every channel open, the drive monitor still measures {silence.drive:.2f} V per V: a "
            "contact is welded closed. Switch the amplifier off and replace the box."
        )
        yield Finding("Contacts", "relay", "red", sentence)
    reached = {p: a.drive for p, a in best.items() if abs(a.drive) > _REACHED}
    if best and not reached:
        sentence = (
            f"{level:g} V were commanded, but the drive monitor measures nothing at any patch: is the "
            "amplifier on, and its input connected? If it has tripped, switch it off and on again."
        )
        yield Finding("Gain", "amplifier", "red", sentence)
        return
    for patch in sorted(best.keys() - reached.keys()):
        sentence = (
            "The box reports this patch as connected, but no voltage reaches it: the contact does not "
            "close, or the wire is disconnected."
        )
        if best[patch].elsewhere:
            sentence = (
                f"The drive of this patch shows on {' and '.join(best[patch].elsewhere)}, and not on its own "
                "monitor: the dividers of two patches are swapped. Swap their cables, or the channels in "
                "[sensors.drive]."
            )
        elif answers.alone:
            sentence += " Or its channel of the amplifier is off, or its divider is not connected."
        yield Finding(f"Patch {patch}", "relay", "red", sentence)
    if answers.alone:
        yield from _gains({f"patch {patch}": gain for patch, gain in sorted(reached.items())})
    elif reached:
        yield from _gains({"the patch": float(np.median(list(reached.values())))})


def _gains(gains: dict[str, float]) -> Iterator[Finding]:
    """Findings on what arrives of a volt; one for all that are right."""
    right = []
    for whose, gain in gains.items():
        measured = f"{gain:.3f} V arrive at {whose} for each volt commanded"
        if abs(gain - 1) > _GAIN:
            what = "correct the gain switch, or gain in [amplifier] and ratio in [sensors.drive]."
            yield Finding("Gain", "amplifier", "red", f"{measured}: {what}")
        else:
            right.append(measured)
    if right and len(gains) == 1:
        yield Finding("Gain", "amplifier", "green", f"{right[0]}.")
    elif right and len(right) == len(gains):
        lowest, highest = min(gains.values()), max(gains.values())
        sentence = f"{lowest:.3f} to {highest:.3f} V arrive at {', '.join(gains)} for each volt commanded."
        yield Finding("Gain", "amplifier", "green", sentence)


def _wiring(in_phase: dict[tuple[str, str], float], patches: list[str]) -> Finding:
    """Compare the channel that drives each place with the rig file."""
    if len(patches) < 2:
        sentence = (
            "Not tested: the test for swapped relay channels needs patch_places in [table], and at least "
            "two patches that move the table."
        )
        return Finding("Wiring", "relay", "yellow", sentence)
    strength = np.abs([[in_phase[place, patch] for patch in patches] for place in patches])
    logs = np.log(np.maximum(strength, 1e-3 * strength.max()))
    found = logs.argmax(axis=1)
    if len(set(found.tolist())) < len(patches):  # scipy.optimize loads longer than doctor looks at a patch
        _, found = scipy.optimize.linear_sum_assignment(-logs)
    gain = float(np.exp(logs[np.arange(len(patches)), found].sum() - np.trace(logs)))
    wrong = [(place, patches[i]) for place, i in zip(patches, found, strict=True) if place != patches[i]]
    if not wrong:
        return Finding("Wiring", "relay", "green", "Each channel drives the patch that the rig file states.")
    told = ", ".join(f"the channel of {patch} drives patch {place}" for place, patch in wrong)
    if gain < _CLEAR:
        sentence = f"Uncertain: it seems that {told}. Check patch_places in [table]."
        return Finding("Wiring", "relay", "yellow", sentence)
    if len(wrong) == 2:
        one, other = wrong[0]
        sentence = (
            f"The channels of patches {one} and {other} are swapped: {told}. Swap the wires, or the "
            "channel numbers in [relay]."
        )
        return Finding("Wiring", "relay", "red", sentence)
    return Finding(
        "Wiring", "relay", "red", f"The channels are mixed up: {told}. Correct the wires, or [relay]."
    )
