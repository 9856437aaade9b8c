"""Pages of the site that are written at each build from what the packages say of themselves: one
for each environment id, one for each wing of the public names, and the documents of the top level.

None of them is kept in git. A new id, a new public name or a new model has its page at once.
"""

import inspect
import re
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from textwrap import dedent
from typing import Any, get_args

import gymnasium
from gymnasium.envs.registration import EnvSpec
from PIL import Image
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

import irs_gym

FEW = {"num_scenes": 8}  # for pictures and spaces, so that no build waits for a thousand maps
BESIDE_THE_TASK = {
    "render_mode": '`"rgb_array"`, `"ansi"`, `"human"`, `"rgb_array_list"` or `"ansi_list"`.',
    "infos": (
        'Keys of `info`: `"all"`, a list of some, or `"fast"`, the default of vector environments,'
        " which leaves out what takes time."
    ),
}
WINGS = {
    "radio": "Scenes, floor plans and radio maps",
    "oracle": "The oracle",
    "bounds": "Certified bounds",
    "mdp": "Robots, costs and codebooks",
    "datasets": "Generated scenes",
    "envs": "Wrappers",
    "grid": "The grid",
    "agents": "Agents",
}
OF_AGENTS = ("agents.load_pretrained", "agents.vec_env.IrsNavVecEnv")
ALIASES = {  # as Python spells out types of NumPy and others -> as they are written
    r"~(?:numpy|typing|collections|pathlib|gymnasium)(?:\.\w+)*\.(?=\w)": "",
    r"ndarray\[tuple\[(?:Any|int), \.\.\.\], dtype\[(\w+)\]\]": r"NDArray[\1]",
    r"_Buffer \| _SupportsArray.*?complex \| bytes \| str\]": "ArrayLike",
}
TOP_LEVEL = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}


def write(path: Path, text: str) -> None:
    """Write a page where it differs, so that Sphinx reads again what has changed alone."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


# --- environments ---------------------------------------------------------------------------------


def own_specs() -> dict[str, EnvSpec]:
    """The ids of this package, in the order of their registration."""
    return {
        each.id: each
        for each in gymnasium.registry.values()
        if str(each.entry_point).startswith("irs_gym.")
    }


def first_of(spec: EnvSpec) -> EnvSpec:
    """The id that this one is a variant of, with the same entry point; itself where none is."""
    alike = [each for each in own_specs().values() if each.entry_point == spec.entry_point]
    return alike[0]


def make(spec: EnvSpec, **arguments: Any) -> Any:
    """The environment over few scenes, which is as large as with many."""
    parameters = inspect.signature(class_of(spec)).parameters
    few = {name: value for name, value in FEW.items() if parameters.get(name, spec)}
    few = {name: value for name, value in few.items() if name in parameters}
    return gymnasium.make(spec.id, **few, **arguments)


def class_of(spec: EnvSpec) -> type[Any]:
    """The environment's class, which its module defines."""
    module = import_module(str(spec.entry_point).partition(":")[0])
    (found,) = [
        each
        for each in vars(module).values()
        if inspect.isclass(each)
        and issubclass(each, gymnasium.Env)
        and each.__module__ == module.__name__
    ]
    return found


def as_markdown(docstring: str, pages: Mapping[str, str]) -> str:
    """A class docstring as Markdown: examples fenced, names and pages linked."""
    fenced = re.sub(
        r"^>>> .*?(?=\n\n|\Z)",
        lambda found: f"```pycon\n{found[0]}\n```",
        docstring,
        flags=re.DOTALL | re.MULTILINE,
    )
    linked = re.sub(r"``docs/(\w+)\.md``", r"[\1](../\1.md)", fenced)

    def link(found: re.Match[str]) -> str:
        name = found[1]
        if name in pages:
            return f"[`{name}`]({pages[name]}.md)"
        if name.removeprefix("irs_gym.") in irs_gym.__all__ and name != found[0]:
            return f"{{py:obj}}`irs_gym.{name.removeprefix('irs_gym.')}`"
        return found[0]

    return re.sub(r"(?<!`)`((?:irs_gym\.)?\w+)`(?!`)", link, linked)


def cell(text: str) -> str:
    """Text of a cell of a table in Markdown."""
    return " ".join(text.split()).replace("|", r"\|")


def type_text(annotation: Any) -> str:
    """A type without the modules of its names."""
    if annotation is inspect.Parameter.empty:
        return ""
    text = inspect.formatannotation(annotation)
    text = re.sub(r"\b(?:\w+\.)+(?=\w)", "", text)
    return text.replace("NoneType", "None")


def field_texts(kind: type[Any]) -> dict[str, str]:
    """What the fields of a dataclass are, by the docstrings below them."""
    found = ModuleAnalyzer.for_module(kind.__module__).find_attr_docs()
    return {
        name: " ".join(lines) for (owner, name), lines in found.items() if owner == kind.__name__
    }


def arguments_table(env: Any) -> str:
    """Every argument of `gymnasium.make` with its type, default and meaning."""
    task = getattr(env.unwrapped, "task", None)
    texts = BESIDE_THE_TASK | (field_texts(type(task)) if task is not None else {})
    rows = ["| argument | type | default | |", "|---|---|---|---|"]
    for name, each in inspect.signature(type(env.unwrapped)).parameters.items():
        if each.kind is inspect.Parameter.VAR_KEYWORD:
            continue
        default = "" if each.default is inspect.Parameter.empty else f"`{each.default!r}`"
        kind = f"`{type_text(each.annotation)}`"
        rows.append(f"| `{name}` | {cell(kind)} | {cell(default)} | {cell(texts.get(name, ''))} |")
    return "\n".join(rows)


def spaces_table(spec: EnvSpec) -> str:
    """The spaces of each kind of observation."""
    parameter = inspect.signature(class_of(spec)).parameters.get("observation")
    kinds = get_args(parameter.annotation) if parameter else ()
    rows = ["| `observation=` | `observation_space` |", "|---|---|"]
    for kind in kinds or (None,):
        try:
            env = make(spec, **({"observation": kind} if kind else {}))
        except (TypeError, ValueError):
            continue  # not offered here
        rows += [
            f"| `{kind!r}`{name and f': `{name}`'} | {cell(f'`{space}`')} |"
            for name, space in parts(env.observation_space)
        ]
    return "\n".join(rows)


def parts(space: gymnasium.Space[Any]) -> Iterator[tuple[str, gymnasium.Space[Any]]]:
    """The space itself, or those of a Dict by their keys."""
    if isinstance(space, gymnasium.spaces.Dict):
        yield from space.spaces.items()
    else:
        yield "", space


def draw(spec: EnvSpec, path: Path) -> None:
    """The picture of an episode on its way, with the oracle's path."""
    env = make(spec, render_mode="rgb_array")
    env.reset(seed=1)
    optimal = getattr(env.unwrapped, "optimal_actions", None)
    env.action_space.seed(0)
    for step in range(16):
        is_led = optimal is not None and step >= 6  # after a few steps astray
        actions = optimal() if is_led else [env.action_space.sample()]
        if not len(actions):
            break
        *_, terminated, truncated, _ = env.step(actions[0])
        if terminated or truncated:
            break
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(env.render()).save(path)
    env.close()


def members(kind: type[Any]) -> str:
    """Reference of what the class has beside Gymnasium's own."""
    public = [
        (name, each)
        for name, each in vars(kind).items()
        if not name.startswith("_") and not hasattr(gymnasium.Env, name) and inspect.getdoc(each)
    ]
    where = f"{kind.__module__}.{kind.__name__}"
    lines = [
        f".. {'autoproperty' if isinstance(each, property) else 'automethod'}:: {where}.{name}"
        for name, each in public
        if isinstance(each, property) or callable(each)
    ]
    return "```{eval-rst}\n" + "\n\n".join(lines) + "\n```"


def environment_page(spec: EnvSpec) -> str:
    """The page of an id that no other is a variant of."""
    env = make(spec)
    kind = type(env.unwrapped)
    pages = {class_of(each).__name__: first_of(each).id for each in own_specs().values()}
    del pages[kind.__name__]
    sections = as_markdown(inspect.getdoc(kind) or "", pages).split("\n## ")
    tables = {
        "Action Space": f"```text\n{env.action_space}\n```",
        "Observation Space": spaces_table(spec),
        "Arguments": arguments_table(env),
    }
    done = []
    for section in sections:
        title = section.partition("\n")[0]
        table = tables.pop(title, "")
        done.append(f"{section.rstrip()}\n\n{table}".rstrip())
    done += [f"{title}\n\n{table}" for title, table in tables.items()]

    variants = [each.id for each in own_specs().values() if first_of(each) == spec]
    others = ", ".join(f"[`{name}`]({name}.md)" for name in variants if name != spec.id)
    facts = [
        f'`gymnasium.make("irs_gym:{spec.id}")`',
        f"truncated after {spec.max_episode_steps} steps",
        *(["vectorised: `gymnasium.make_vec`"] if spec.vector_entry_point else []),
        *([f"variants: {others}"] if others else []),
    ]
    summary, *rest = done
    body = "\n\n## ".join(rest)
    return (
        f"# {spec.id}\n\n{summary}\n\n![The oracle's path, and a robot's, in {spec.id}]"
        f"(pictures/{spec.id}.png)\n\n{'; '.join(facts)}.\n\n## {body}\n\n"
        f"## Methods and properties\n\nOf `env.unwrapped`, an `{kind.__module__}.{kind.__name__}`,"
        f" beside those of `gymnasium.Env`:\n\n{members(kind)}\n"
    )


def given(spec: EnvSpec) -> str:
    """The arguments of an id's own, as they are written."""
    return ", ".join(f"{name}={value!r}" for name, value in spec.kwargs.items())


def variant_page(spec: EnvSpec) -> str:
    """The page of an id that is another with arguments of its own."""
    env = make(spec)
    first = first_of(spec)
    rows = [
        f"| `{name or 'the observation'}` | {cell(f'`{space}`')} |"
        for name, space in parts(env.observation_space)
    ]
    return (
        dedent(
            f"""\
        # {spec.id}

        [`{first.id}`]({first.id}.md) with `{given(spec)}`, for programs that take an id and
        nothing else. All the rest is as told there: rewards, episodes, arguments, methods.

        ![The oracle's path, and a robot's, in {spec.id}](pictures/{spec.id}.png)

        | | space |
        |---|---|
        | the action | {cell(f"`{env.action_space}`")} |
        """
        )
        + "\n".join(rows)
        + "\n"
    )


def write_environments(folder: Path) -> None:
    """A page and a picture for each id, and the list of them."""
    rows = ["| | id | |", "|---|---|---|"]
    for name, spec in own_specs().items():
        picture = folder / "pictures" / f"{name}.png"
        if not picture.exists():
            draw(spec, picture)
        is_first = first_of(spec) is spec
        write(folder / f"{name}.md", environment_page(spec) if is_first else variant_page(spec))
        said = (inspect.getdoc(class_of(spec)) or "").partition("\n\n")[0]
        said = said if is_first else f"`{first_of(spec).id}` with `{given(spec)}`."
        thumbnail = f"![{name}](pictures/{name}.png){{width=180px}}"
        rows.append(f"| {thumbnail} | [`{name}`]({name}.md) | {cell(said)} |")

    order = "\n".join(own_specs())
    listed = "\n".join(rows)
    write(
        folder / "index.md",
        "# Environments\n\n"
        "Each page is made from the class, the registry and the spaces. What all have in common"
        f" stands in [the task](../concepts/task.md).\n\n{listed}\n\n"
        f"```{{toctree}}\n:hidden:\n\n{order}\n```\n",
    )


# --- public names ---------------------------------------------------------------------------------


def write_api(folder: Path) -> None:
    """A page for each wing with the reference of its public names, and the list of them."""
    wings: dict[str, list[str]] = {}
    for name, home in irs_gym._HOMES.items():
        wings.setdefault(home.partition(".")[0], []).append(f"irs_gym.{name}")
    wings["agents"] = list(OF_AGENTS)

    index = ["# Reference", "", "Every public name, by what it is about.", ""]
    for wing in [*WINGS, *(each for each in wings if each not in WINGS)]:
        title = WINGS.get(wing, wing)
        names = sorted(wings.get(wing, []), key=lambda name: name.rpartition(".")[2].lower())
        if not names:
            continue
        blocks = [f"# {title}", *(reference(name) for name in names)]
        write(folder / f"{wing}.md", "\n\n".join(blocks) + "\n")
        rows = [f"| {{py:obj}}`{name}` | {cell(first_line(name))} |" for name in names]
        index += [f"## [{title}]({wing}.md)", "", "| name | |", "|---|---|", *rows, ""]

    pages = "\n".join(each for each in [*WINGS, *wings] if wings.get(each))
    order = "\n".join(dict.fromkeys(pages.split("\n")))
    write(folder / "index.md", "\n".join(index) + f"\n```{{toctree}}\n:hidden:\n\n{order}\n```\n")


def found(name: str) -> Any:
    """What a dotted name stands for."""
    module, _, last = name.rpartition(".")
    return getattr(import_module(module), last)


def first_line(name: str) -> str:
    """The first sentence of a name's docstring, as Markdown."""
    summary = (inspect.getdoc(found(name)) or "").partition("\n\n")[0]
    return summary.replace("``", "`")


def reference(name: str) -> str:
    """Autodoc's directive for a name."""
    kind = "autoclass" if inspect.isclass(found(name)) else "autofunction"
    return f"```{{eval-rst}}\n.. {kind}:: {name}\n```"


def short_types(
    app: Sphinx,
    what: str,
    name: str,
    thing: Any,
    options: Any,
    given: str | None,
    returned: str | None,
) -> tuple[str | None, str | None]:
    """A signature with NumPy's aliases as we write them, and not as they are spelt out."""

    def short(text: str | None) -> str | None:
        for long, alias in ALIASES.items():
            text = re.sub(long, alias, text) if text else text
        return text

    return short(given), short(returned)


# --- documents of the top level, and models -------------------------------------------------------


def write_top_level(docs: Path) -> None:
    """`CONTRIBUTING.md` and `CHANGELOG.md` as pages, their links turned to where they lie now."""
    for name, page in TOP_LEVEL.items():
        text = (docs.parent / name).read_text(encoding="utf-8")
        write(docs / page, re.sub(r"\]\((?!https?:|#)([^)]+)\)", lambda at: relink(at[1]), text))


def relink(target: str) -> str:
    """The end of a link of the top level, seen from `docs/`."""
    if target in TOP_LEVEL:
        return f"]({TOP_LEVEL[target]})"
    return f"]({target.removeprefix('docs/') if target.startswith('docs/') else f'../{target}'})"


def to_pages(app: Sphinx, name: str, source: list[str]) -> None:
    """Links to documents of the top level lead to their pages."""
    for file, page in TOP_LEVEL.items():
        source[0] = source[0].replace(f"](../{file})", f"]({page})")


def write_models(docs: Path) -> None:
    """The model cards, which lie beside the models."""
    for card in sorted((docs.parent / "models").glob("*.md")):
        text = card.read_text(encoding="utf-8")
        if card.name == "README.md":
            text += "\n```{toctree}\n:hidden:\n:glob:\n\n*\n```\n"
        write(docs / "models" / card.name, text)


def write_pages(app: Sphinx, config: Any) -> None:
    """Write all of them into the folder of the sources."""
    docs = Path(app.srcdir)
    write_environments(docs / "environments")
    write_api(docs / "api")
    write_models(docs)
    write_top_level(docs)


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the pages before any is read."""
    app.connect("config-inited", write_pages)
    app.connect("source-read", to_pages)
    app.connect("autodoc-process-signature", short_types)
    return {"version": irs_gym.__version__, "parallel_read_safe": True}
