"""Read a file that haploop wrote into the views that formats write."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy

from .. import __version__
from ..acquisition import Curve, Recording, Representative, Study, content_hash, open_part
from ..acquisition.presses import PRESS_COLUMNS, press_rows
from ..base.arrays import FloatArray
from ..base.errors import DataError
from ..calibration import Calibration, Check, DigitalButton, Drive, Response, VibrationMap
from ..terminal.progress import SIMULATED
from .views import About, Channel, Envelope, PressTable, Responses, Signals

_SMOOTHING = 0.002
"""s: standard deviation of the window over which amplitude and frequency are averaged; a click lasts 10."""
_LINE_ERROR = 0.01
"""Largest error of an envelope's straight lines, of its peak."""
_AUDIBLE = 0.05
"""Amplitude below which a frequency is noise, and the nearest one above it is kept."""
_FREQUENCY_ERROR = 10.0
"""Hz; a fingertip tells 20 % apart at best."""
_MOST_POINTS = 200


def recording_signals(path: Path) -> Signals:
    """All channels of a recording in SI units, or its volts when it has no sensor. Raises DataError."""
    recording = Recording.open(path)
    sensors, channels = recording.sensors, []
    if sensors.force is not None:
        channels.append(Channel("force", "N", recording.force, recording.delay("force")))
    if sensors.displacement is not None:
        channels.append(Channel("travel", "m", recording.travel, recording.delay("displacement")))
    if sensors.velocity is not None:
        channels.append(Channel("velocity", "m/s", recording.velocity, recording.delay("velocity")))
    vertical = ""
    if sensors.acceleration is not None:
        delay, axes = recording.delay("acceleration"), sensors.acceleration.axes
        vertical = f"acceleration_{axes[sensors.acceleration.row]}"
        for axis, row in zip(axes, recording.acceleration, strict=True):
            channels.append(Channel(f"acceleration_{axis}", "m/s^2", row, delay))
    if sensors.activation is not None:
        channels.append(Channel("activation", "1", recording.activation, recording.delay("activation")))
    for name, sensor in sensors.extra.items():
        channels.append(Channel(name, sensor.unit, recording.extra[name], recording.delay(name)))
    if not channels:
        rows = zip(recording.channels, recording.volts, recording.header.delays, strict=True)
        channels = [Channel(name, "V", row, float(delay)) for name, row, delay in rows]
    names = [channel.name for channel in channels]
    header = recording.header
    more: About = {
        "button": recording.button,
        "participant": recording.participant,
        "study": header.study,
        "session": header.session,
        "rig": recording.rig,
        "started": header.started,
        "complete": recording.complete,
    }
    return Signals(
        title=f"Presses of {recording.button} by {recording.participant}",
        rate_hz=recording.rate_hz,
        channels=tuple(channels),
        main=vertical or names[0],
        about=_about(path, recording.simulated, more),
    )


def representative_signals(path: Path) -> Signals:
    """Acceleration, force, travel, activation and spread of a representative press. Raises DataError."""
    press = Representative.load(path)
    slow = (("force", "N", press.force), ("travel", "m", press.travel))
    return Signals(
        title=f"Representative press of {press.button}",
        rate_hz=press.rate_hz,
        channels=(
            Channel("acceleration", "m/s^2", press.acceleration),
            *(Channel(name, unit, values) for name, unit, values in slow if values is not None),
            Channel("activation", "1", press.activation),
            Channel("spread", "m/s^2", press.spread),
        ),
        main="acceleration",
        about=_press_about(path, press),
    )


def drive_signals(path: Path) -> Signals:
    """Volts at the patch, and the target's acceleration. Raises DataError."""
    drive = Drive.load(path)
    channels = (*_volts(drive), *_targets(drive))
    about = _about(path, drive.simulated, _drive_about(drive))
    return Signals(f"Drive of {drive.button}", drive.rate_hz, channels, channels[0].name, about)


def check_signals(path: Path) -> Signals:
    """Target, mean of the plays, and each play, of a check. Raises DataError."""
    check = Check.load(path)
    return Signals(
        f"Check of {check.drive.button}",
        check.rate_hz,
        _check_channels(check),
        "measured",
        _about(path, check.simulated, _check_about(check)),
    )


def button_signals(path: Path) -> Signals:
    """The volts of a digital button, its target, and its check at the volts' rate. Raises DataError."""
    button = DigitalButton.load(path)
    drive, check = button.drive, button.check
    time = np.arange(len(drive.target)) / drive.rate_hz
    measured = np.interp(time, np.arange(len(check.measured)) / check.rate_hz, check.measured, right=0.0)
    channels = (*_volts(drive), *_targets(drive), Channel("measured", "m/s^2", measured))
    about = _about(path, button.simulated, _check_about(check))
    return Signals(f"Digital button {drive.button}", drive.rate_hz, channels, channels[0].name, about)


def calibration_responses(path: Path) -> Responses:
    """The response of a calibration. Raises DataError."""
    response = Calibration.load(path).response
    title = f"Response of patch {response.patch} at the {response.point} point"
    more: About = {"rig": response.rig, "started": response.created, "excitation": response.excitation}
    return Responses(title, (response,), _about(path, response.simulated, more))


def map_responses(path: Path) -> Responses:
    """The responses of a map's points to each patch, from its fitted modes. Raises DataError."""
    found = VibrationMap.load(path)
    plan = found.plan
    f = np.arange(np.ceil(plan.low), plan.high + 1e-9, 1 / plan.period)
    none = np.zeros(0)
    responses = tuple(
        Response(
            patch=patch,
            point=point,
            frequencies=f,
            velocity=velocity,
            deviation=none,
            coherence=none,
            path=np.ones(len(f), dtype=np.complex128),
            noise=none,
            distortion=np.zeros((0, 0)),
            repeats=1,
            level=plan.level,
            levels=none,
            level_gain=none.astype(np.complex128),
            pickup_range=np.inf,
            excitation="vibration map: the modes fitted to all of its points",
            source="map",
            rig=plan.rig,
            rig_file=plan.rig_file,
            simulated=plan.simulated,
            created="",
        )
        for patch in plan.patches
        for point, velocity in zip(found.points, found.velocity(patch, f), strict=True)
    )
    about = _about(path, plan.simulated, {"rig": plan.rig}, plan.digest)
    cells = [divmod(int(response.point), plan.columns) for response in responses]
    return Responses(f"Vibration map of {len(found.points)} points", responses, about, np.array(cells))


def recording_presses(paths: Sequence[Path]) -> PressTable:
    """One row a press of several recordings. Raises DataError."""
    recordings = [Recording.open(path) for path in paths]
    simulated = any(recording.simulated for recording in recordings)
    about: About = {
        "source": ", ".join(path.name for path in paths),
        "simulated": simulated,
        **_software(simulated),
    }
    return PressTable(
        f"Presses of {len(recordings)} recordings", PRESS_COLUMNS, tuple(press_rows(recordings)), about
    )


def study_presses(study: Study) -> PressTable:
    """One row a press of a study. Raises ConfigurationError and DataError."""
    # One recording in memory at a time.
    recordings = (open_part(path, study.file.name) for paths in study.parts().values() for path in paths)
    rows = tuple(press_rows(recordings))
    simulated = any(row["simulated"] for row in rows)
    about: About = {"source": study.path.name, "simulated": simulated, **_software(simulated)}
    return PressTable(f"Study {study.file.name}", PRESS_COLUMNS, rows, about)


def curve_rows(path: Path) -> PressTable:
    """One row a row of a force-travel curve: travel, force, stroke, and the switch where it was measured.

    Raises DataError.
    """
    curve = Curve.load(path)
    units = {"travel_mm": "mm", "force_N": "N", "stroke": ""} | ({"switch": ""} if len(curve.contact) else {})
    columns = zip(curve.travel.tolist(), curve.force.tolist(), strict=True)
    rows = [
        {
            "travel_mm": float(f"{1e3 * x:.9g}"),
            "force_N": force,
            "stroke": "down" if n <= curve.turn else "up",
        }
        for n, (x, force) in enumerate(columns)
    ]
    for row, closed in zip(rows, curve.contact.tolist(), strict=False):
        row["switch"] = int(closed)
    more: About = {"button": curve.button, "measured": curve.source, "sha256": curve.source_sha256}
    about = _about(path, curve.simulated, more)
    return PressTable(f"Force over travel of {curve.button}", units, tuple(rows), about)


def envelope_of_representative(path: Path) -> Envelope:
    """Envelope of a representative press. Raises DataError."""
    press = Representative.load(path)
    title = f"Press of {press.button}"
    return _envelope(title, press.acceleration, press.rate_hz, _press_about(path, press))


def envelope_of_button(path: Path) -> Envelope:
    """Envelope of what the table is to play of a digital button: its drive's target. Raises DataError."""
    button = DigitalButton.load(path)
    about = _about(path, button.simulated, _drive_about(button.drive))
    return _envelope(f"Target of {button.drive.button}", button.drive.target, button.drive.rate_hz, about)


def envelope_of_press(path: Path) -> Envelope:
    """Envelope of the recorded press of a digital button, at its own level. Raises DataError."""
    button = DigitalButton.load(path)
    about = _about(path, button.press.simulated, {"button": button.press.button})
    return _envelope(
        f"Press of {button.press.button}", button.press.acceleration, button.press.rate_hz, about
    )


def envelope_of_drive(path: Path) -> Envelope:
    """Envelope of a drive's target. Raises DataError."""
    drive = Drive.load(path)
    about = _about(path, drive.simulated, _drive_about(drive))
    return _envelope(f"Target of {drive.button}", drive.target, drive.rate_hz, about)


def envelope_of_check(path: Path) -> Envelope:
    """Envelope of the motion measured in a check. Raises DataError."""
    check = Check.load(path)
    about = _about(path, check.simulated, _check_about(check))
    return _envelope(f"Measured motion of {check.drive.button}", check.measured, check.rate_hz, about)


def _check_channels(check: Check) -> tuple[Channel, ...]:
    plays = [Channel(f"play_{n}", "m/s^2", row) for n, row in enumerate(check.accelerations, 1)]
    return (Channel("target", "m/s^2", check.target), Channel("measured", "m/s^2", check.measured), *plays)


def _envelope(title: str, acceleration: FloatArray, rate_hz: float, about: About) -> Envelope:
    """Amplitude and mean frequency over short windows, as few straight lines.

    The frequency is the mean of the instantaneous one, weighted by power: the spectrum's centroid. Raises
    DataError for a press without motion.
    """
    analytic = np.asarray(scipy.signal.hilbert(acceleration))
    # Hilbert's amplitude of a click has notches where its partials beat: the window fills them.
    width = _SMOOTHING * rate_hz
    power = scipy.ndimage.gaussian_filter1d(np.abs(analytic) ** 2, width)
    amplitude = np.sqrt(power)
    peak = float(amplitude.max(initial=0.0))
    if not np.isfinite(peak) or peak == 0:
        raise DataError(f"{about['source']} holds no motion that a phone could play.")
    turned = np.angle(analytic[1:] * np.conj(analytic[:-1])) * rate_hz / (2 * np.pi)
    turned = np.append(turned, turned[-1:])
    weighted = scipy.ndimage.gaussian_filter1d(turned * np.abs(analytic) ** 2, width)
    frequency = np.clip(weighted / np.maximum(power, 1e-12 * power.max()), 0.0, 1000.0)
    strong = np.flatnonzero(amplitude > _AUDIBLE * peak)
    samples = np.arange(len(amplitude))
    after = np.clip(np.searchsorted(strong, samples), 0, len(strong) - 1)
    before = np.maximum(after - 1, 0)
    is_before = samples - strong[before] < strong[after] - samples
    nearest = np.where(is_before, strong[before], strong[after])
    frequency = frequency[nearest]
    times = samples / rate_hz
    kept = _breakpoints([amplitude / peak / _LINE_ERROR, frequency / _FREQUENCY_ERROR])
    return Envelope(title, times[kept], amplitude[kept] / peak, frequency[kept], peak, about)


def _breakpoints(curves: list[FloatArray]) -> list[int]:
    """Indices between which straight lines are off by 1 at most in every curve, or `_MOST_POINTS` of them."""
    x = np.arange(len(curves[0]))
    kept = [0, len(x) - 1]
    while len(kept) < _MOST_POINTS:
        errors = np.max([np.abs(np.interp(x, kept, curve[kept]) - curve) for curve in curves], axis=0)
        worst = int(np.argmax(errors))
        if errors[worst] <= 1:
            break
        kept = sorted([*kept, worst])
    return kept


def _press_about(path: Path, press: Representative) -> About:
    more: About = {
        "button": press.button,
        "presses": press.members,
        "method": press.method,
        "activation_s": press.activation_index / press.rate_hz,
        "bandwidth_hz": press.bandwidth_hz,
        "motion": press.motion,
        "activated_by": press.activated_by,
    }
    return _about(path, press.simulated, more)


def _volts(drive: Drive) -> tuple[Channel, ...]:
    """The volts of each patch; of one alone they have no other name."""
    names = ["volts"] if len(drive.patches) == 1 else [f"volts_{patch}" for patch in drive.patches]
    return tuple(Channel(name, "V", own) for name, own in zip(names, drive.volts, strict=True))


def _targets(drive: Drive) -> tuple[Channel, ...]:
    """The target of the drive's own point, and those of others with a button of their own."""
    others = [(f"target_{one.point}", one.target) for one in drive.elsewhere if one.button]
    return tuple(Channel(name, "m/s^2", target) for name, target in (("target", drive.target), *others))


def _drive_about(drive: Drive) -> About:
    return {
        "button": drive.button,
        "rig": drive.rig,
        "patch": drive.patch,
        "point": drive.point,
        "scale": drive.scale,
        "method": drive.method,
        "carrier_hz": drive.carrier_hz,
    }


def _check_about(check: Check) -> About:
    error: About = {"error": check.error} if np.isfinite(check.error) else {}
    return {**_drive_about(check.drive), "verdict": check.verdict, **error}


def _about(path: Path, simulated: bool, more: About, content: str = "") -> About:
    digest = content or content_hash(path)
    own: About = {"source": path.name, "content_hash": digest, "simulated": bool(simulated)}
    return {**own, **_software(simulated), **more}


def _software(simulated: bool) -> About:
    said = {"software": f"haploop {__version__}"}
    return said | {"note": SIMULATED} if simulated else said
