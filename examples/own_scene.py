"""A scene of your own: the paper's factory with one more cabinet, from data to the shortest path.

`irs_gym/scenes/paper.json` shows every field. A mistake is told by its field.
"""

import gymnasium

import irs_gym

data = irs_gym.load_scene("paper").to_data()
data["name"] = "with a cabinet"
data["obstacles"].append({"center": [0.0, -5.0], "size": [2.0, 1.0, 2.0]})

irs_gym.Scene.from_data(data).save("factory.json")  # a file to keep and to hand on

for scene in ("paper", "factory.json"):
    env = gymnasium.make("irs_gym:IrsNav-v0", scene=scene, target_db=-62.5, irs_elements=2400)
    _, info = env.reset(seed=0)
    is_feasible = env.unwrapped.radio_map.feasible(-62.5)
    print(
        f"{scene}: {is_feasible.sum()} cells meet -62.5 dB,"
        f" the shortest path is {info['oracle_distance']:.3f} m"
    )
