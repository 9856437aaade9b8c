"""A map of your own: gains that you have measured or traced, in place of a scene.

A cell (i, j) is i along x, j along y; -inf marks where no robot can be.
"""

import gymnasium
import numpy as np

import irs_gym

gain_db = np.full((20, 12), -60.0)  # (X, Y)
gain_db[8:12, 2:] = -75.0  # a shadow, with a way around it
gain_db[3, 3:9] = -np.inf  # a shelf

radio_map = irs_gym.RadioMap.from_array(gain_db, cell_size=0.5, origin=(0.0, 0.0))
radio_map.save("measured.npz")

for target_db in (-80.0, -70.0):
    env = gymnasium.make(
        "irs_gym:IrsNav-v0",
        radio_map="measured.npz",
        start=(0, 6),
        goal=(19, 6),
        target_db=target_db,
        render_mode="ansi",
    )
    _, info = env.reset(seed=0)
    print(f"at {target_db} dB: {info['oracle_distance']:.3f} m\n{env.render()}")
