"""Clouds for the tests."""

import numpy as np
import pytest


def on_sphere(count, centre=(0.0, 0.0, 0.0), dtype=np.float64):
    z = (2 * np.arange(count) + 1.0) / count - 1
    angle, r = 2.399963 * np.arange(count), np.sqrt(1 - z * z)
    return (np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1) + np.asarray(centre)).astype(dtype)


@pytest.fixture(scope="session")
def sphere():
    return on_sphere
