"""Facts of compiled functions: they do what Python does, wherever their files lie."""

import numpy as np

from agents.compiled import compiled


def test_a_function_of_no_file_is_compiled_all_the_same():
    """Nothing can be kept for it."""
    names: dict = {}
    exec("def squares(n):\n    return [i * i for i in range(n)]", names)
    assert compiled(names["squares"])(4) == [0, 1, 4, 9]


def test_a_compiled_function_computes_in_the_precision_of_what_it_takes():
    product = compiled(lambda one, other: one * other)
    third = np.float32(1.0) / np.float32(3.0)
    assert product(third, third) == third * third
