"""Small things that all figures share."""

from __future__ import annotations

import numpy as np

from granular_id.plotting.style import evenly, middles_to_edges, number_text


def test_places_edges_and_numbers():
    assert [evenly(9, 3).tolist(), evenly(2, 5).tolist(), evenly(0, 5).tolist()] == [[0, 4, 8], [0, 1], []]
    assert middles_to_edges(np.array([1.0, 2.0, 4.0])).tolist() == [0.5, 1.5, 3.0, 5.0]
    assert [number_text(-0.04, 1), number_text(-1.25, 2)] == ["0.0", "\N{MINUS SIGN}1.25"]
