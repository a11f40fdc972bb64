"""Contents of a calibration and of a drive, as a table and as JSON values."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table

from ...calibration import Calibration, Drive, Waveforms
from .formatting import damping, json_number, percent, property_table

__all__ = ["calibration_contents", "drive_contents", "waveforms_contents"]


def calibration_contents(calibration: Calibration) -> tuple[dict[str, Any], Table]:
    """Return the contents as JSON values and as a table."""
    response, model = calibration.response, calibration.model
    radius = response.confidence()
    values: dict[str, Any] = {
        "kind": "calibration",
        "simulated": response.simulated,
        "rig": response.rig,
        "created": response.created,
        "patch": response.patch,
        "point": response.point,
        "band_hz": [json_number(response.frequencies[0]), json_number(response.frequencies[-1])],
        "repeats": response.repeats,
        "source": response.source,
        "excitation": response.excitation,
        "confidence": json_number(np.median(radius) / np.abs(response.velocity).max())
        if radius.size
        else None,
        "coherence_min": json_number(response.coherence.min()) if response.coherence.size else None,
        "coherence_median": json_number(np.median(response.coherence)) if response.coherence.size else None,
        "resonance_hz": json_number(model.resonance_hz),
        "carriers_hz": [json_number(r.frequency_hz) for r in model.carriers],
        "model_error": json_number(model.error),
        "stable": bool(model.stable),
        "resonances": [
            {
                "frequency_hz": json_number(r.frequency_hz),
                "damping": json_number(r.damping),
                "damping_interval": [json_number(limit) for limit in r.damping_interval],
                "damping_is_bound": r.damping_is_bound,
                "strength": json_number(r.strength),
            }
            for r in model.resonances
        ],
    }
    table = property_table(f"Calibration of patch {response.patch} at the {response.point} point")
    table.add_row("Rig", f"{response.rig}, {response.created}")
    table.add_row(
        "Response",
        f"{response.frequencies[0]:.0f} to {response.frequencies[-1]:.0f} Hz, {response.repeats} repeats",
    )
    table.add_row("Excitation", response.excitation)
    if response.source != "measured":
        table.add_row("Source", response.source)
    median, lowest = values["coherence_median"], values["coherence_min"]
    coherence = "not measured" if lowest is None else f"median {median:.4f}, lowest {lowest:.4f}"
    table.add_row("Coherence", coherence)
    table.add_row("Resonance", f"{model.resonance_hz:.2f} Hz (the strongest of {len(model.resonances)})")
    table.add_row("Damping ratio", damping(model.carriers[0]))
    if model.ambiguity:
        table.add_row("Carrier", model.ambiguity)
    table.add_row(
        "Model", f"{percent(model.error)} from the response, {'stable' if model.stable else 'UNSTABLE'}"
    )
    return values, table


def drive_contents(drive: Drive) -> tuple[dict[str, Any], Table]:
    """Return the contents as JSON values and as a table."""
    peak_to_peak = float(np.ptp(drive.volts))
    values: dict[str, Any] = {
        "kind": "drive",
        "simulated": drive.simulated,
        "button": drive.button,
        "patch": drive.patch,
        "rate_hz": json_number(drive.rate_hz),
        "duration_s": json_number(len(drive.volts) / drive.rate_hz),
        "drive_peak_v": json_number(drive.peak),
        "drive_peak_to_peak_v": json_number(peak_to_peak),
        "method": drive.method,
        "unreached": drive.unreached,
        "carrier_hz": json_number(drive.carrier_hz),
        "band_hz": [json_number(edge) for edge in drive.band],
        "scale": json_number(drive.scale),
        "in_band": json_number(drive.in_band),
        "predicted_error": json_number(drive.predicted_error),
    }
    table = property_table(f"Drive of the {drive.button} button at patch {drive.patch}")
    table.add_row("Voltage", f"{drive.peak:.1f} V peak, {peak_to_peak:.1f} V peak to peak")
    table.add_row("Length", f"{1e3 * len(drive.volts) / drive.rate_hz:.0f} ms at {drive.rate_hz:g} Hz")
    table.add_row("Method", drive.method)
    table.add_row("Carrier", f"{drive.carrier_hz:.2f} Hz")
    table.add_row(
        "Band", f"{drive.band[0]:.0f} to {drive.band[1]:.0f} Hz, {percent(drive.in_band)} of the energy"
    )
    table.add_row("Scale", f"{drive.scale:.4f} of the recorded acceleration")
    table.add_row("Predicted error", percent(drive.predicted_error))
    if drive.unreached:
        table.add_row("Not reached", drive.unreached)
    return values, table


def waveforms_contents(waveforms: Waveforms) -> tuple[dict[str, Any], Table]:
    """Return the contents as JSON values and as a table."""
    captures = waveforms.captures
    channels = sorted({channel for capture in captures for channel in capture.channels})
    values: dict[str, Any] = {
        "kind": "waveforms",
        "simulated": waveforms.simulated,
        "calibration": waveforms.calibration,
        "patch": waveforms.patch,
        "point": waveforms.point,
        "plays": len(captures),
        "seconds": json_number(waveforms.seconds),
        "channels": channels,
        "rate_hz": json_number(captures[0].rate_hz) if captures else None,
    }
    table = property_table(f"Waveforms of a calibration of patch {waveforms.patch}, {waveforms.point} point")
    table.add_row("Plays", f"{len(captures)}, {waveforms.seconds:.1f} s in all")
    table.add_row("Channels", ", ".join(channels))
    table.add_row("Calibration", f"SHA-256 {waveforms.calibration}")
    return values, table
