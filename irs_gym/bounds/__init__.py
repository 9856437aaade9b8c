"""The continuous problem: bounds of its optimum that are proved."""
