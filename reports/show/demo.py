"""The result of a demo, on standard output."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.box import SIMPLE
from rich.table import Table

from ...terminal.progress import print_line, print_table
from .formatting import fixed, interval, percent, verdict

__all__ = ["show_demo"]


def show_demo(summary: Mapping[str, Any]) -> None:
    """Print the result of a demo."""
    table = Table(box=SIMPLE, title="From a press to a verified digital button", title_justify="left")
    table.add_column("Button")
    for heading in (
        "Presses",
        "Force",
        "(true)",
        "Drive",
        "In band",
        "Error",
        "(95 %)",
        "Outside",
        "Felt",
        "Verdict",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, button in summary["buttons"].items():
        table.add_row(
            name,
            f"{button['presses_detected']}/{button['presses']}",
            fixed(button["activation_force_n"], 2, "N"),
            fixed(button["activation_force_true_n"], 2, "N"),
            fixed(button["drive_peak_v"], 1, "V"),
            percent(button["in_band"]),
            percent(button["wideband_nrmse"]),
            interval(button["wideband_interval"]),
            percent(button["outside"]),
            button["feeling"]["felt"],
            verdict(button["verdict"]),
        )
    print_table(table)
    for name, button in summary["buttons"].items():
        for sentence in (*button["reasons"], *button["notes"]):
            print_line(f"{name}: {sentence}")
    for note in summary["notes"]:
        print_line(note)
    print_line(
        "In band: share of the modulated press's energy within the band that is played. Error: of the "
        "whole motion, "
        "with its 95 % confidence interval; outside: motion outside the band, over the target's. "
        "Felt: whether thresholds of detection say that a finger feels it."
    )
    print_line(
        f"Resonance {summary['resonance_hz']:.2f} Hz (true: {summary['resonance_true_hz']:.2f} Hz). "
        f"{summary['simulated_s']:.0f} s of simulated time in {summary['wall_s']:.0f} s."
    )
    print_line(f"Everything here is simulated ({summary['mode']}, seed {summary['seed']}).")
    print_line(f"Report: {summary['report']}")
