"""Scores, figures and measurements, each a command of `python -m eval`; it reads what training
wrote.
"""
