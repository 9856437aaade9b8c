"""`Run`: the folder of one training run, which training writes and evaluation reads.

- ``manifest.json``: status, versions, commit, and the SHA-256 of all files below but the curve,
  signed with a key of the user's own. It makes a folder a run.
- ``config.json``: algorithm, seed, environment and settings; a scene, map or codebook of the user's
  own is copied beside it.
- ``learning_curve.csv``: a row for each evaluation during training.
- ``best-STEPS.npz``, ``last-STEPS.npz``: models, as plain arrays.
- ``checkpoint-STEPS.pickle``: the state of a training that has not ended, to go on from; the newest
  two.

Nothing but a checkpoint is ever unpickled, and that only where the user goes on with a run: one
that the signature tells to be of the user's own, or that the user trusts.

Files are replaced as a whole, and a new model gets a new name, so that a run killed at any moment
leaves a manifest and the files that it names. Whoever changes the folder NAME holds the lock
``.NAME.lock`` beside it.
"""

import csv
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from hashlib import sha256
from io import StringIO
from pathlib import Path
from typing import Any, TypeVar

from filelock import FileLock, Timeout
from pydantic import ValidationError

from agents.registry import generalists
from agents.rollout.episode import SceneTask, scene_task_of
from agents.runs import provenance, signature, weights
from agents.runs.manifest import Config, FileEntry, GeneralistEntry, Manifest, ModelEntry, Record
from irs_gym.files import read_file, write_file
from irs_gym.radio.codebook import Codebook
from irs_gym.radio.radio_map import RadioMap, as_scene
from irs_gym.radio.scene import scene_names

CHECKPOINTS = 2  # kept, so that there is one to fall back on
# bytes at most in a file, by its suffix; a checkpoint may hold a large replay buffer
MOST_BYTES = {".json": 2**22, ".npz": 2**28, ".pickle": 2**34}
COPIES = {
    "scene": "scene.json",
    "radio_map": "radio_map.npz",
    "codebook": "codebook.npz",
}  # of the user's own files, within the folder


class RunError(ValueError):
    """A run folder that is missing, damaged, or not to be replaced."""


class LockedError(RunError):
    """A run folder that another process is working on."""


_AnyRecord = TypeVar("_AnyRecord", bound=Record)


@dataclass(frozen=True)
class Run:
    """A run folder; `create` makes a new one, `open` checks an old one."""

    folder: Path

    @classmethod
    def create(cls, folder: str | Path, config: Config, *, overwrite: bool = False) -> "Run":
        """A new run folder with its configuration, in place of an old run where ``overwrite`` is
        set.

        Raises
        ------
        RunError
            Where the folder holds a run that is not to be replaced, or anything that is not a run.
        """
        run = cls(Path(folder))

        with run.locked():
            run.begin(config, overwrite=overwrite)

        return run

    def begin(self, config: Config, *, overwrite: bool = False) -> None:
        """What `create` does, for whoever holds the lock already."""
        self.check_vacant(overwrite=overwrite)
        target = self.folder.resolve()
        draft = Run(target.with_name(f".{target.name}.{os.getpid()}"))
        aside = target.with_name(f"{draft.folder.name}.old")

        try:
            _remove_leftovers(target)
            draft.folder.mkdir()
            draft._write(
                "config.json",
                config.model_copy(update={"env": _with_copies(config.env, draft.folder)}),
            )
            origin = {"versions": provenance.versions(), "commit": provenance.commit()}
            draft._write("manifest.json", _signed(Manifest(files=_digests(draft.folder), **origin)))
            _put_in_place(draft.folder, target, aside)
        except OSError as error:
            raise RunError(f"{str(self.folder)!r} cannot be made: {error}") from None
        finally:
            shutil.rmtree(draft.folder, ignore_errors=True)
            shutil.rmtree(aside, ignore_errors=True)

    @classmethod
    def open(cls, folder: str | Path) -> "Run":
        """An old run folder; raises `RunError` where it is none or damaged."""
        run = cls(Path(folder))
        if not (run.folder / "manifest.json").is_file():
            raise RunError(f"{str(folder)!r} is not a run folder: it has no manifest.json")

        _ = run.manifest, run.is_generalist or run.task

        return run

    def check_vacant(self, *, overwrite: bool) -> None:
        """Raise `RunError` where `create` would."""
        if self.folder.is_symlink():
            raise RunError(
                f"{str(self.folder)!r} is a symbolic link: name the folder that it leads to"
            )

        target = self.folder.absolute()
        here = Path.cwd()
        if target.exists() and any(target.samefile(each) for each in (here, *here.parents)):
            raise RunError(
                f"{str(self.folder)!r} holds the folder that this program runs in: "
                "name another folder"
            )
        if not self.folder.exists() or (self.folder.is_dir() and not any(self.folder.iterdir())):
            return
        if not (self.folder / "manifest.json").is_file():
            raise RunError(
                f"{str(self.folder)!r} exists and is not a run folder: it is never replaced"
            )
        if not overwrite:
            raise RunError(
                f"{str(self.folder)!r} holds a run: name another folder, "
                "or replace it with --overwrite"
            )

    @property
    def manifest(self) -> Manifest:
        """Status, versions, commit and models."""
        return self._parse("manifest.json", self._content("manifest.json"), Manifest)

    @property
    def config(self) -> Config:
        """Algorithm, seed and settings; raises `RunError` where the manifest has others."""
        return self._parse("config.json", self._checked("config.json"), Config)

    def own_manifest(self) -> Manifest:
        """The manifest, when this user has signed it; else a `RunError`, as its checkpoint may hold
        anyone's code.
        """
        manifest = self.manifest

        try:
            if signature.verify(manifest.content, manifest.signature):
                return manifest
            why = f"its manifest is not signed with the key {str(signature.key_file())!r}"
        except signature.NoKeyError as error:
            why = f"there is no key to tell by: {error}"

        raise RunError(
            f"{str(self.folder)!r} is not known to be made by you on this machine ({why}), "
            "and to resume it runs code that is stored in its checkpoint, with all your rights: "
            "add --trust if you trust whoever made it"
        )

    def adopt(self) -> Manifest:
        """Sign the manifest, as it is now, as this user's own; returns it."""
        manifest = _signed(self.manifest)
        self._write("manifest.json", manifest)
        return manifest

    @property
    def is_generalist(self) -> bool:
        """Whether many scenes were trained on, and not one task."""
        return self.config.algorithm in generalists()

    @property
    def task(self) -> SceneTask:
        """The environment that was trained on; raises `RunError` for a generalist."""
        if self.is_generalist:
            raise RunError(
                f"{str(self.folder)!r} is a run of {self.config.algorithm}, "
                "which learned on many scenes"
            )

        arguments = dict(self.config.env)
        for name, copy in COPIES.items():
            if arguments.get(name) == copy:
                self._checked(copy)
                arguments[name] = self.folder / copy
            elif not _is_named(name, arguments.get(name)):
                where = str(self.folder / "config.json")
                raise RunError(
                    f"{where!r}: {name}={arguments[name]!r} is not in the folder: "
                    f"a run has a copy, {copy}"
                )

        try:
            return scene_task_of(arguments)
        except (TypeError, ValueError) as error:
            raise RunError(f"{str(self.folder / 'config.json')!r}: {error}") from None

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other processes from training into the folder and from replacing it.

        Raises
        ------
        LockedError
            Where another process does so.
        RunError
            Where the lock, a file beside the folder, cannot be made.
        """
        try:
            target = self.folder.resolve()  # one lock by whatever name
            target.parent.mkdir(parents=True, exist_ok=True)
            path = target.parent / f".{target.name}.lock"
            lock = FileLock(path)
            lock.acquire(timeout=0.1)
        except Timeout:
            if not os.path.lexists(
                path
            ):  # which the lock takes for another process that is just making it
                raise RunError(
                    f"{str(self.folder)!r} cannot be locked: {str(path)!r} cannot be made"
                ) from None
            raise LockedError(f"{str(self.folder)!r} is being trained by another process") from None
        except (OSError, RuntimeError) as error:  # the latter for links that lead in a circle
            raise RunError(f"{str(self.folder)!r} cannot be locked: {error}") from None

        try:
            yield
        finally:
            with suppress(OSError):  # Windows removes it by itself
                path.unlink()

            lock.release()

    def update(self, **changes: Any) -> None:
        """Change fields of the manifest, then remove the files that it no longer names.

        What this user had not signed stays unsigned.
        """
        old = self.manifest
        manifest = old.model_copy(update=changes)
        self._write("manifest.json", _signed(manifest) if _is_own(old) else manifest)
        named = {entry.file for entry in (*manifest.models.values(), *manifest.checkpoints)}

        for path in self.folder.iterdir():
            if re.fullmatch(r"\w+-\d+\.(zip|npz|pickle)", path.name) and path.name not in named:
                path.unlink(missing_ok=True)

    def save_model(self, name: str, model: Any, steps: int, **result: Any) -> None:
        """Write what acts of a model under a name (``"best"``, ``"last"``), in place of the one
        before it.

        ``result`` is how it did in its test: the other fields of `ModelEntry`, or for a generalist
        of `GeneralistEntry`.
        """
        file = f"{name}-{steps}.npz"
        digest = self._write_hashed(file, weights.pack(self.config, model))
        kind = GeneralistEntry if self.is_generalist else ModelEntry
        entry = kind(file=file, sha256=digest, steps=steps, **result)
        self.update(models={**self.manifest.models, name: entry})

    def load_model(self, name: str = "best") -> Any:
        """The policy of that name, to act with; nothing is unpickled.

        Raises
        ------
        RunError
            Where the manifest lists no such model, or its file is missing, another, or does not fit
            the configuration.
        """
        content = self.read_model(name)
        config = self.config

        try:
            return weights.load(config, None if self.is_generalist else self.task, content)
        except weights.WeightsError as error:
            file = self.folder / self.manifest.models[name].file
            raise RunError(f"{str(file)!r} is not loaded: {error}") from None

    def read_model(self, name: str = "best") -> bytes:
        """Content of that model's file; raises what `load_model` does."""
        entry = self.manifest.models.get(name)
        if entry is None:
            raise RunError(f"the manifest of {str(self.folder)!r} lists no {name!r} model")

        return self.read(entry)

    def save_checkpoint(self, content: bytes, steps: int) -> None:
        """Write the state of the training after so many steps, and keep the one before it."""
        file = f"checkpoint-{steps}.pickle"
        entry = FileEntry(file=file, sha256=self._write_hashed(file, content), steps=steps)
        older = [each for each in self.manifest.checkpoints if each.file != file]
        self.update(checkpoints=(entry, *older)[:CHECKPOINTS])

    def rewind(
        self,
        checkpoint: FileEntry,
        models: Mapping[str, tuple[ModelEntry | GeneralistEntry, bytes]],
    ) -> None:
        """Go back to where a checkpoint was written, with the models that there were then."""
        for entry, content in models.values():
            write_file(self.folder / entry.file, content)

        self.remove_drafts()
        older = [each for each in self.manifest.checkpoints if each.steps <= checkpoint.steps]
        entries = {name: entry for name, (entry, _) in models.items()}
        self.update(status="running", error=None, models=entries, checkpoints=tuple(older))

    def remove_drafts(self) -> None:
        """Remove files that were half written when a process was killed."""
        for path in self.folder.iterdir():
            if re.fullmatch(r"\..+\.\d+(-[0-9a-f]+)?", path.name) and not path.is_dir():
                path.unlink()

    def read(self, entry: FileEntry) -> bytes:
        """Content of a file that the manifest lists; raises `RunError` where it is missing or
        another.
        """
        return self._checked(entry.file, entry.sha256)

    def write_curve(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write the learning curve: rows with the same keys; a None is left empty."""
        text = StringIO()
        writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        write_file(self.folder / "learning_curve.csv", text.getvalue().encode())

    def _checked(self, name: str, digest: str | None = None) -> bytes:
        """Content of a file, which must have that SHA-256, by default the one of the manifest's
        `files`.
        """
        path = str(self.folder / name)
        wanted = digest or self.manifest.files.get(name)
        if wanted is None:
            raise RunError(f"{path!r} is not read: the manifest holds no SHA-256 of it; train anew")

        content = self._content(name)
        found = sha256(content).hexdigest()
        if found != wanted:
            raise RunError(
                f"{path!r} is not loaded: its SHA-256 is {found}, and {wanted} in the manifest"
            )

        return content

    def _content(self, name: str) -> bytes:
        path = self.folder / name
        try:
            return read_file(path, MOST_BYTES.get(path.suffix, 0))
        except ValueError as error:
            raise RunError(str(error)) from None
        except OSError as error:
            listed = "" if name == "manifest.json" else ", which the manifest lists,"
            raise RunError(f"{str(path)!r}{listed} cannot be read: {error.strerror}") from None

    def _parse(self, name: str, content: bytes, kind: type[_AnyRecord]) -> _AnyRecord:
        try:
            return kind.model_validate_json(content)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(map(str, first["loc"]))
            raise RunError(
                f"{str(self.folder / name)!r} is damaged: {where or 'the file'}: {first['msg']}"
            ) from None
        except ValueError as error:
            raise RunError(str(error)) from None

    def _write_hashed(self, file: str, content: bytes) -> str:
        write_file(self.folder / file, content)
        return sha256(content).hexdigest()

    def _write(self, name: str, record: Record) -> None:
        write_file(self.folder / name, (record.model_dump_json(indent=2) + "\n").encode())


def _digests(folder: Path) -> dict[str, str]:
    """SHA-256 of the configuration and of the copies beside it, by their names."""
    names = [name for name in ("config.json", *COPIES.values()) if (folder / name).exists()]
    return {name: sha256((folder / name).read_bytes()).hexdigest() for name in names}


def _signed(manifest: Manifest) -> Manifest:
    """The manifest with this user's signature; without one where there can be no key."""
    try:
        return manifest.model_copy(update={"signature": signature.sign(manifest.content)})
    except signature.NoKeyError:
        return manifest.model_copy(update={"signature": None})


def _is_own(manifest: Manifest) -> bool:
    try:
        return signature.verify(manifest.content, manifest.signature)
    except signature.NoKeyError:
        return False


def _put_in_place(draft: Path, target: Path, aside: Path) -> None:
    """Rename the draft to the target, and what is there to ``aside``; where that fails, all is as
    it was.
    """
    try:
        if target.exists():
            target.rename(aside)

        draft.rename(target)
    except BaseException:
        if aside.exists() and not target.exists():
            aside.rename(target)

        raise


def _remove_leftovers(target: Path) -> None:
    """Remove what processes that were killed while they made a run have left beside its folder,
    which is locked.
    """
    pattern = re.compile(rf"\.{re.escape(target.name)}\.\d+(\.old)?")

    for path in target.parent.iterdir():
        if pattern.fullmatch(path.name) and path.is_symlink():
            path.unlink()
        elif pattern.fullmatch(path.name):
            shutil.rmtree(path, ignore_errors=True)


def _is_named(name: str, value: Any) -> bool:
    """Whether an argument is none of the user's own: nothing, a scene of the package, or a design
    of codebooks.
    """
    if value is None or (name == "scene" and value in scene_names()):
        return True
    return name == "codebook" and isinstance(value, list | tuple)


def _with_copies(env: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Arguments of an environment with the user's own scene, map or codebook copied into the
    folder.
    """
    arguments = dict(env)
    scene = arguments.get("scene")
    radio_map = arguments.get("radio_map")
    if scene is not None and scene not in scene_names():
        as_scene(scene).save(folder / COPIES["scene"])
        arguments["scene"] = COPIES["scene"]

    if radio_map is not None:
        copy = radio_map if isinstance(radio_map, RadioMap) else RadioMap.load(radio_map)
        copy.save(folder / COPIES["radio_map"], fading=True)
        arguments["radio_map"] = COPIES["radio_map"]

    codebook = arguments.get("codebook")
    if not _is_named("codebook", codebook):
        own = codebook if isinstance(codebook, Codebook) else Codebook.load(codebook)  # type: ignore[arg-type]
        own.save(folder / COPIES["codebook"])
        arguments["codebook"] = COPIES["codebook"]

    return arguments
