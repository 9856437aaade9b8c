"""The command ``python -m irs_gym.proof``: proves that the frozen splits are what they were; see
`verify_splits`.
"""

from runpy import run_module

if __name__ == "__main__":
    run_module("irs_gym.datasets.verify_splits", run_name="__main__")
