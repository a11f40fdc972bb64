"""What a participant is asked in a step, for their page and for a preview."""

from __future__ import annotations

from typing import Any

from ...experiments import ExperimentFile, Step


def question(file: ExperimentFile, step: Step, turn: str) -> dict[str, Any]:
    """What the page asks: text, and choices or scales; `turn` comes back with the answer."""
    asked: dict[str, Any] = {"turn": turn, "kind": step.kind, "text": step.text}
    match step.kind:
        case "presses":
            times = "once" if step.repetitions == 1 else f"{step.repetitions} times"
            name = next(iter(step.stimulus.values()), "")
            asked["text"] = f"Press the physical {name} button {times}."
        case "finger":
            asked["text"] = f"A {step.stimulus['press']} press."
        case "rating":
            low, high = step.values
            pairs = zip(step.choices, file.question.pairs, strict=True)
            asked |= {"pairs": [[name, *ends] for name, ends in pairs], "low": low, "high": high}
        case "identification":
            asked["choices"] = [[name, name] for name in step.choices]
        case _:
            asked["choices"] = [[1, "First"], [2, "Second"]]
    return asked
