"""What was understood of a file of another program."""

from __future__ import annotations

import numpy as np

from ...reports import contents
from ...reports.contents import Cell, Contents, Drawing, Grid, fact
from .. import shown
from ..importing import Understanding, becomes, curve_of, presses_in


def understanding_contents(found: Understanding) -> Contents:
    """What a file holds, what is taken for what, and what only a person can know.

    Raises ConfigurationError and DataError for a file that is said to be a curve, and holds none.
    """
    if found.mapping.make == "curve" and not found.questions:
        return contents.curve_contents(curve_of(found))
    table, roles = found.table, {signal.number: signal for signal in found.signals.values()}
    rows, columns = [], []
    for number, column in enumerate(table.columns):
        finite = column.values[np.isfinite(column.values)]
        low, high = (float(finite.min()), float(finite.max())) if len(finite) else (np.nan, np.nan)
        signal = roles.get(number)
        role = signal.role if signal else ""
        how = (
            ""
            if signal is None
            else signal.why + (f"; {signal.unit}" if signal.unit not in ("", column.unit) else "")
        )
        rows.append([
            str(number), column.name, "date and time" if column.stamps else column.unit, f"{low:.5g}",
            f"{high:.5g}", role or Cell("not imported", "aside"), how]
        )  # fmt: skip
        columns.append({
            "number": number, "name": column.name, "unit": column.unit, "min": low, "max": high, "role": role,
            "why": signal.why if signal else "", "si_per_unit": signal.factor if signal else None,
        })  # fmt: skip
    open_ = found.questions
    presses = () if open_ else presses_in(found)
    times = ", ".join(f"{instant:.2f}" for instant in presses[:12]) + (" ..." if len(presses) > 12 else "")
    what = "" if open_ else becomes(found)
    count = f"{len(presses)} press{'' if len(presses) == 1 else 'es'}"
    facts = [
        fact("File", str(found.path), file=found.path),
        fact("Read as", table.kind, read_as=table.kind),
        fact(columns=columns, mapping=found.mapping.model_dump(exclude_none=True)),
        fact("Understood", list(found.notes), notes=found.notes, rate_hz=found.rate_hz),
        fact(started=None if found.start is None else found.start.contents),
        fact(
            "Presses found",
            None if open_ else f"{len(presses)}{f', at {times} s' if presses else ''}",
            presses_s=presses,
            duration_s=None if open_ else found.duration,
        ),
        fact("Becomes", what and f"a {what} ({count} in {found.duration:.3g} s)", becomes=what),
        fact(
            "Not said",
            [Cell(f"{one.what}: {one.option}", "doubtful") for one in open_],
            questions=[{"key": one.key, "what": one.what, "option": one.option} for one in open_],
        ),
    ]
    drawing = Drawing.alone(
        "columns",
        "A file as it was understood",
        contents.words.COLUMNS,
        lambda columns: shown.columns_figure([found], columns),
        found.path.name,
    )
    drawn = any(len(signal.values) for signal in found.signals.values())
    return Contents(
        f"What {found.path.name} holds",
        facts,
        tables=[
            Grid("Columns", ("", "heading", "unit", "smallest", "largest", "taken as", "why"), rows, words=3)
        ],
        kind="columns",
        simulated=bool(table.about.get("simulated", False)) or None,
        picture=drawing if drawn else None,
        undrawn=f"{found.path} cannot be drawn before its questions are answered.",
    )
