"""Scores of policies on scenes that they did not learn on."""
