"""The style of all pictures: ticks that show the whole value."""

from __future__ import annotations

import pytest

from hpop.view.page import new_figure
from hpop.view.style import whole_ticks


@pytest.mark.parametrize("limits", [(0.0, 2.14e-5), (-3e-7, 2e-7), (0.0, 8e6), (0.01319, 0.013206), (1e6, 1e6 + 2)])
def test_a_tick_says_its_whole_value_without_words_at_the_end_of_the_axis(limits):
    figure = new_figure(4, 3)
    axes = figure.add_subplot(ylim=limits)
    whole_ticks(axes.yaxis, False)
    figure.canvas.draw()
    said = [float(text.get_text().replace("\N{MINUS SIGN}", "-")) for text in axes.get_yticklabels()]
    assert said == pytest.approx(list(axes.get_yticks()), rel=1e-9, abs=1e-15)
    assert len(said) > 2
    assert axes.yaxis.get_offset_text().get_text() == ""
