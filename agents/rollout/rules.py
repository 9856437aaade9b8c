"""`RULES`: what a move does and what it pays, for those who learn and are tested over many
scenes.
"""

from irs_gym.datasets.random_task import RandomTask
from irs_gym.mdp.task import Rules

# Those of `IrsNavRandom-v0` where nothing else is asked for: cells below the target are refused,
# rewards are shaped, and lengths are in metres whatever the size of the cells.
RULES: Rules = RandomTask().rules
