"""The p that an analysis of variance reports, by its definition."""

import pytest

from haploop.experiments.analysis.anova import Effect, Sphericity


@pytest.mark.parametrize(
    ("mauchly", "violated", "reported"), [(0.011, True, 0.07), (0.049, True, 0.07), (0.05, False, 0.02)]
)
def test_p_is_corrected_where_mauchlys_test_rejects_sphericity_at_five_percent(mauchly, violated, reported):
    sphericity = Sphericity(0.8, mauchly, 0.7, 0.75, 0.07, 0.06)
    effect = Effect("session", ("session",), 4.0, 20.0, 2, 20, 4.8, 0.02, sphericity, 0.2, 0.1)
    assert (effect.violated, effect.reported_p) == (violated, reported)
