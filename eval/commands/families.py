"""`python -m eval families`: writes docs/families.md, the families of generated factories and the
detours in them.
"""

import sys
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from time import process_time

import numpy as np
from PIL import Image

from eval.markdown import page, table, template
from eval.pictures import write_pictures
from eval.unseen.scores import detours
from irs_gym.datasets.random_task import RandomTask, build_worlds
from irs_gym.datasets.scene_set import SceneSet, build_scene_set
from irs_gym.datasets.splits import FAMILIES, scene_of
from irs_gym.files import write_file
from irs_gym.rendering import draw_frame
from irs_gym.rendering.episode_view import view_of

PAGE = "families.md"
FIGURES = "figures/families"
WORDS = {
    "maze": "a tree of corridors of 0.5, 1 or 1.5 m, with some ways around; no panel",
    "doors": "6 to 14 rooms with doors",
    "spiral": "one wall that winds inwards; no panel",
    "zigzag": "walls across the room, with a door at one end and the other in turn; no panel",
    "trap": "walls in the shape of a U, in which the robot starts; with and without a panel",
    "racks": "a warehouse: racks with aisles, of which pallets close some",
    "hall": "26 to 32 m by 10 to 14 m, with boxes; with and without a panel",
    "aps": "2 to 4 access points; with and without a panel",
}
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
TIMED = 20  # scenes
PICTURE_SIZE = 420  # px


def main(out: Path = Path("docs"), num_scenes: int = 1000) -> int:
    """Draw two scenes of each family, tell the detours in its frozen set, and write families.md.

    Parameters
    ----------
    out
        Folder of the page.
    num_scenes
        Scenes of each set, from the first on.
    """
    try:
        pools = {name: build_scene_set(f"ood-{name}", num_scenes) for name in FAMILIES}
        write_pictures(out / FIGURES, {f"{name}.png": picture(pools[name]) for name in pools})
        write_file(out / PAGE, families_page(pools).encode())
    except (OSError, ValueError) as error:
        print(f"python -m eval families: {error}", file=sys.stderr)
        return 2

    print(f"written: {out / PAGE}")
    return 0


def families_page(pools: dict[str, SceneSet]) -> str:
    """The page, with what is computed in its places."""
    header = ("set", "what", "detour: least", "25 %", "median", "75 %", "most", "longest way (m)")
    pictures = "\n\n".join(
        f"`ood-{name}`: {WORDS[name]}.\n\n![{name}]({FIGURES}/{name}.png)" for name in pools
    )
    words = template(PAGE).format(
        scenes=f"{max(map(len, pools.values())):,}",
        rows=table(header, [family_row(name, pool) for name, pool in pools.items()]),
        timed=TIMED,
        speed=table(
            ("set", "milliseconds a scene"),
            [(f"`train-{name}`", f"{1e3 * seconds_a_scene(name):.0f}") for name in pools],
        ),
        pictures=pictures,
    )

    return page(words)


def family_row(name: str, pool: SceneSet) -> tuple[str, ...]:
    """A set, with the quantiles of its detours."""
    quantiles = np.quantile(detours(pool), SHARES)
    return (
        f"`ood-{name}`",
        WORDS[name],
        *(f"{each:.2f}" for each in quantiles),
        f"{pool.oracle_distance.max():.1f}",
    )


def seconds_a_scene(name: str) -> float:
    """Processor's time to draw a scene of a family with its map and distances to go."""
    began = process_time()
    for index in range(TIMED):
        scene_of(f"train-{name}", index)

    return (process_time() - began) / TIMED


def picture(pool: SceneSet) -> bytes:
    """The first two scenes of a set beside each other, as a PNG."""
    worlds = build_worlds(RandomTask(scenes=pool))
    frames = []

    for number in range(min(2, len(pool))):
        world = worlds.world(number)
        view = replace(view_of(world, world.start, world.goal), size=PICTURE_SIZE, is_square=False)
        frames.append(Image.fromarray(draw_frame(view, [world.start])))

    sizes = np.array([frame.size for frame in frames])  # (2, 2), width and height
    both = Image.new("RGB", (int(sizes[:, 0].sum()), int(sizes[:, 1].max())), "white")
    left = 0
    for frame in frames:
        both.paste(frame, (left, 0))
        left += frame.width

    content = BytesIO()
    both.save(content, format="png", optimize=True)

    return content.getvalue()
