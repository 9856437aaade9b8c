"""Uniform-cost search over saved states: the environment is its own model.

`get_state` saves where an episode stands, `set_state` goes back to it. The search knows neither the
map nor the oracle, and finds the oracle's distance.
"""

from heapq import heappop, heappush

import gymnasium

env = gymnasium.make("irs_gym:IrsNav-v0", observation="cell", target_db=-61.8).unwrapped
cell, start_info = env.reset(seed=0)

frontier = [(0.0, cell, env.get_state(), False)]  # metres, cell, state, whether at the goal
closed = set()
steps = 0

while frontier:
    distance, cell, state, is_at_goal = heappop(frontier)
    if is_at_goal:
        break
    if cell in closed:
        continue

    closed.add(cell)
    for action in range(8):
        env.set_state(state)
        next_cell, _, terminated, _, info = env.step(action)
        steps += 1
        if next_cell not in closed:
            heappush(frontier, (info["distance"], next_cell, env.get_state(), terminated))

print(
    f"{distance:.3f} m after {steps} steps; the oracle needs {start_info['oracle_distance']:.3f} m"
)
