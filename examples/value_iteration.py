"""Tabular value iteration over the exact transitions, held against `optimal_q`."""

import gymnasium
import numpy as np

GAMMA = 0.98

env = gymnasium.make("irs_gym:IrsNav-v0", observation="cell", target_db=-61.8)
observation, info = env.reset(seed=0)
table = env.unwrapped.transition_table()  # arrays (cells, 8)
continues = ~table.is_terminated

q = np.zeros(table.reward.shape)  # (cells, 8), metres
change = np.inf
sweeps = 0

while change > 1e-9:
    values = q.max(axis=1)  # (cells,)
    updated = table.reward + GAMMA * continues * values[table.next_cell]
    change = np.abs(updated - q).max()
    q = updated
    sweeps += 1

print(f"{sweeps} sweeps, {np.abs(q - env.unwrapped.optimal_q(GAMMA)).max():.0e} m off optimal_q")

# The greedy policy of the table, played from the start.
is_over = False

while not is_over:
    observation, _, terminated, truncated, info = env.step(q[observation].argmax())
    is_over = terminated or truncated

print(f"{info['distance']:.3f} m, SPL {info['spl']:.3f}")
