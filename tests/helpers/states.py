"""Random admissible states of the pendulum; the scenarios of elements."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

import tcbench


def _polar(radius, angle):
    return np.array([radius * np.cos(angle), radius * np.sin(angle)])


@st.composite
def admissible_states(draw):
    """(q, p, theta) of the pendulum: springs of length 0.3 to 5, |p| up to 3 a component, 150 to 600 in temperature."""
    length, angle = st.floats(0.3, 5.0), st.floats(0.0, 2 * np.pi)
    q1 = _polar(draw(length), draw(angle))
    q2 = q1 + _polar(draw(length), draw(angle))
    p = draw(st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4))
    theta = draw(st.lists(st.floats(150.0, 600.0), min_size=2, max_size=2))
    return np.concatenate([q1, q2, p, theta])


def with_elements():
    """The scenarios of springs and gases, by name: what methods that are written in elements run on."""
    return {name: s for name, s in tcbench.scenarios().items() if s.model.defines("element_energy")}
