"""Training runs, each an algorithm of `python -m train`; they end in a run folder."""
