"""PPO of Stable-Baselines3, then one episode of its greedy policy.

python examples/sb3_ppo.py 300000    # steps: a minute or two of one core, and the optimum
"""

import sys

import gymnasium
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 300_000

envs = make_vec_env("irs_gym:IrsNavFlat-v0", n_envs=16, env_kwargs={"random_start": 0.7})
model = PPO(
    "MlpPolicy",
    envs,
    n_steps=64,
    batch_size=256,
    learning_rate=1e-3,
    gamma=0.98,
    gae_lambda=0.98,
    ent_coef=0.05,
    seed=0,
)
model.learn(steps)

env = gymnasium.make("irs_gym:IrsNavFlat-v0")
observation, info = env.reset(seed=0)
is_over = False

while not is_over:
    action, _ = model.predict(observation, deterministic=True)
    observation, _, terminated, truncated, info = env.step(int(action))
    is_over = terminated or truncated

print(
    f"after {model.num_timesteps} steps: success {info['is_success']}, {info['distance']:.3f} m,"
    f" SPL {info['spl']:.3f}"
)
