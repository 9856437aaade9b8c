"""Communication-aware navigation as a Gymnasium benchmark, with exact radio maps and an exact
oracle.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from gymnasium.envs.registration import register, registry

if TYPE_CHECKING:
    from irs_gym.bounds.certified import Bounds as Bounds
    from irs_gym.bounds.certified import certified_bounds as certified_bounds
    from irs_gym.datasets.generator import Difficulty as Difficulty
    from irs_gym.datasets.generator import generate_scene as generate_scene
    from irs_gym.envs.cost_steps import SixTuple as SixTuple
    from irs_gym.envs.cost_steps import VectorReward as VectorReward
    from irs_gym.grid import Grid as Grid
    from irs_gym.mdp.configurations import FewestConfigurations as FewestConfigurations
    from irs_gym.mdp.configurations import cover_codebook as cover_codebook
    from irs_gym.mdp.configurations import fewest_configurations as fewest_configurations
    from irs_gym.mdp.cost import cost_map as cost_map
    from irs_gym.mdp.robot import Robot as Robot
    from irs_gym.oracle.belief_optimum import BeliefNode as BeliefNode
    from irs_gym.oracle.belief_optimum import BeliefOptimum as BeliefOptimum
    from irs_gym.oracle.belief_optimum import belief_optimum as belief_optimum
    from irs_gym.oracle.budget_to_go import BudgetToGo as BudgetToGo
    from irs_gym.oracle.budget_to_go import budget_to_go as budget_to_go
    from irs_gym.oracle.euclidean_to_go import EuclideanToGo as EuclideanToGo
    from irs_gym.oracle.euclidean_to_go import euclidean_distance_to_go as euclidean_distance_to_go
    from irs_gym.oracle.joint import JointPath as JointPath
    from irs_gym.oracle.joint import highest_joint_target as highest_joint_target
    from irs_gym.oracle.joint import joint_distance_to_go as joint_distance_to_go
    from irs_gym.oracle.joint import joint_shortest_path as joint_shortest_path
    from irs_gym.oracle.pareto_front import Front as Front
    from irs_gym.oracle.pareto_front import pareto_front as pareto_front
    from irs_gym.oracle.shortest_lengths import shortest_lengths as shortest_lengths
    from irs_gym.oracle.shortest_path import Path as Path
    from irs_gym.oracle.shortest_path import distance_to_go as distance_to_go
    from irs_gym.oracle.shortest_path import highest_feasible_target as highest_feasible_target
    from irs_gym.oracle.shortest_path import shortest_path as shortest_path
    from irs_gym.oracle.straight_line import Polyline as Polyline
    from irs_gym.oracle.straight_line import straight_line_bound as straight_line_bound
    from irs_gym.oracle.straight_line import straight_line_path as straight_line_path
    from irs_gym.oracle.switch_front import SwitchFront as SwitchFront
    from irs_gym.oracle.switch_front import switch_front as switch_front
    from irs_gym.oracle.trade_off import TradeOff as TradeOff
    from irs_gym.oracle.trade_off import trade_off as trade_off
    from irs_gym.radio.codebook import Codebook as Codebook
    from irs_gym.radio.codebook import codebook_gain_db as codebook_gain_db
    from irs_gym.radio.codebook import dft_codebook as dft_codebook
    from irs_gym.radio.codebook import focused_codebook as focused_codebook
    from irs_gym.radio.outage import outage_probability as outage_probability
    from irs_gym.radio.radio_map import RadioMap as RadioMap
    from irs_gym.radio.radio_map import build_phase_shifts as build_phase_shifts
    from irs_gym.radio.radio_map import build_radio_map as build_radio_map
    from irs_gym.radio.readers.floor_plan import FloorPlan as FloorPlan
    from irs_gym.radio.readers.geojson import read_geojson as read_geojson
    from irs_gym.radio.readers.movingai import MovingAiScenario as MovingAiScenario
    from irs_gym.radio.readers.movingai import read_movingai_map as read_movingai_map
    from irs_gym.radio.readers.movingai import read_movingai_scenarios as read_movingai_scenarios
    from irs_gym.radio.readers.picture import read_picture as read_picture
    from irs_gym.radio.readers.ros_map import read_ros_map as read_ros_map
    from irs_gym.radio.rssi import from_rssi_histograms as from_rssi_histograms
    from irs_gym.radio.scene import Scene as Scene
    from irs_gym.radio.scene import load_scene as load_scene
    from irs_gym.radio.sionna import from_sionna as from_sionna

__version__ = "0.1.0"

# Names are looked up in their modules on first use, so that `import irs_gym` costs little more than
# gymnasium.
_HOMES = {
    "Bounds": "bounds.certified",
    "certified_bounds": "bounds.certified",
    "Difficulty": "datasets.generator",
    "generate_scene": "datasets.generator",
    "SixTuple": "envs.cost_steps",
    "VectorReward": "envs.cost_steps",
    "Grid": "grid",
    "Robot": "mdp.robot",
    "cost_map": "mdp.cost",
    "BeliefNode": "oracle.belief_optimum",
    "BeliefOptimum": "oracle.belief_optimum",
    "belief_optimum": "oracle.belief_optimum",
    "BudgetToGo": "oracle.budget_to_go",
    "budget_to_go": "oracle.budget_to_go",
    "EuclideanToGo": "oracle.euclidean_to_go",
    "euclidean_distance_to_go": "oracle.euclidean_to_go",
    "Front": "oracle.pareto_front",
    "pareto_front": "oracle.pareto_front",
    "FewestConfigurations": "mdp.configurations",
    "cover_codebook": "mdp.configurations",
    "fewest_configurations": "mdp.configurations",
    "JointPath": "oracle.joint",
    "highest_joint_target": "oracle.joint",
    "joint_distance_to_go": "oracle.joint",
    "joint_shortest_path": "oracle.joint",
    "Path": "oracle.shortest_path",
    "distance_to_go": "oracle.shortest_path",
    "highest_feasible_target": "oracle.shortest_path",
    "shortest_lengths": "oracle.shortest_lengths",
    "shortest_path": "oracle.shortest_path",
    "outage_probability": "radio.outage",
    "Codebook": "radio.codebook",
    "codebook_gain_db": "radio.codebook",
    "dft_codebook": "radio.codebook",
    "focused_codebook": "radio.codebook",
    "RadioMap": "radio.radio_map",
    "build_phase_shifts": "radio.radio_map",
    "build_radio_map": "radio.radio_map",
    "FloorPlan": "radio.readers.floor_plan",
    "read_geojson": "radio.readers.geojson",
    "MovingAiScenario": "radio.readers.movingai",
    "read_movingai_map": "radio.readers.movingai",
    "read_movingai_scenarios": "radio.readers.movingai",
    "read_picture": "radio.readers.picture",
    "read_ros_map": "radio.readers.ros_map",
    "from_rssi_histograms": "radio.rssi",
    "Scene": "radio.scene",
    "load_scene": "radio.scene",
    "from_sionna": "radio.sionna",
    "Polyline": "oracle.straight_line",
    "straight_line_bound": "oracle.straight_line",
    "straight_line_path": "oracle.straight_line",
    "SwitchFront": "oracle.switch_front",
    "switch_front": "oracle.switch_front",
    "TradeOff": "oracle.trade_off",
    "trade_off": "oracle.trade_off",
}
__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'irs_gym' has no attribute {name!r}")
    return getattr(import_module(f"irs_gym.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])


_IRS_NAV = ("irs_gym.envs.nav:make_env", "irs_gym.envs.vector_nav:make_vector_env")
_IRS_NAV_RANDOM = (
    "irs_gym.envs.random_nav:make_env",
    "irs_gym.envs.random_vector_nav:make_vector_env",
)

_IRS_NAV_CODEBOOK = (
    "irs_gym.envs.codebook_nav:make_env",
    "irs_gym.envs.codebook_vector_nav:make_vector_env",
)

_IRS_NAV_CONTINUOUS = (
    "irs_gym.envs.continuous_nav:make_env",
    "irs_gym.envs.continuous_vector_nav:make_vector_env",
)

for _id, (_entry_point, _vector_entry_point), _arguments in (
    ("IrsNav-v0", _IRS_NAV, {}),
    ("IrsNavFlat-v0", _IRS_NAV, {"observation": "flat"}),
    ("IrsNavRandom-v0", _IRS_NAV_RANDOM, {}),
    ("IrsNavRandomFlat-v0", _IRS_NAV_RANDOM, {"observation": "flat"}),
    ("IrsNavCodebook-v0", _IRS_NAV_CODEBOOK, {}),
    ("IrsNavContinuous-v0", _IRS_NAV_CONTINUOUS, {}),
):
    if _id not in registry:
        register(
            id=_id,
            entry_point=_entry_point,
            vector_entry_point=_vector_entry_point,
            max_episode_steps=400,
            order_enforce=False,  # the environment itself refuses steps out of order
            disable_env_checker=True,  # and the tests run Gymnasium's checker
            kwargs=_arguments,
        )
