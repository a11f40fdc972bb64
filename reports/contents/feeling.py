"""What a finger would feel of a check's motion: facts for people, values for JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from ...calibration import Feeling
from ...calibration.perception import Levels
from .parts import Fact, detailed, fact, plain


def loudness(feeling: Feeling) -> str:
    """How loud the measured motion is beside the recorded press; "" where that is not known."""
    if not math.isfinite(feeling.loudness_db):
        return ""
    than = "quieter" if feeling.loudness_db < 0 else "louder"
    return f"{abs(feeling.loudness_db):.1f} dB {than} than the press"


def feeling_values(feeling: Feeling) -> dict[str, Any]:
    """Levels above threshold, bands, parts and sentences, for JSON."""
    found: dict[str, Any] = {
        "felt": feeling.felt,
        "sentence": feeling.sentence,
        "force_n": feeling.force,
        "acts": {
            one.act.name: {
                "above_threshold_db": one.level,
                "higher_db": one.act.higher,
                "lower_db": one.act.lower,
                "spread_db": one.act.spread,
                "threshold": one.act.mark,
                "people": one.people,
                "felt": one.answer,
            }
            for one in feeling.acts
        },
        "difference_felt": feeling.difference,
        "difference_comparable": feeling.comparable,
        "loudness_db": feeling.loudness_db,
        "levels": {
            name: {
                "above_pressing_threshold_db": level.pressing,
                "above_resting_threshold_db": level.resting,
                "bands_db": level.bands,
            }
            for name, level in _signals(feeling).items()
        },
        "noise_above_pressing_threshold_db": feeling.noise_total,
        "third_octaves_hz": feeling.octaves_hz,
        "resting_threshold_db": feeling.resting_db,
        "pressing_threshold_db": feeling.pressing_db,
        "reference_m_s2": 1e-6,
        "above_threshold_s": feeling.spans,
        "lost_s": feeling.lost,
        "notes": feeling.notes,
    }
    return {name: plain(value) for name, value in found.items()}


def feeling_facts(feeling: Feeling) -> Iterator[Fact]:
    """Whether it can be felt, how loud it is, and in detail: each act, the levels, and what they rest on."""
    names = {"residual": "difference", "recorded": "recorded press"}
    levels = ", ".join(
        f"{names.get(name, name)} {level.pressing:+.1f} dB" for name, level in _signals(feeling).items()
    )
    yield fact("Can be felt", feeling.sentence)
    if beside := loudness(feeling):
        yield fact("Beside the recorded press", beside)
    yield from detailed(
        [
            fact("By other acts", [one.sentence() for one in feeling.acts[1:]]),
            fact("Above a pressing finger's threshold", levels, feeling=feeling_values(feeling)),
            fact("On feeling", list(feeling.notes)),
        ]
    )


def _signals(feeling: Feeling) -> dict[str, Levels]:
    recorded = {} if feeling.recorded is None else {"recorded": feeling.recorded}
    return {"target": feeling.target, "measured": feeling.measured, "residual": feeling.residual, **recorded}
