"""`checked_mode`: the autoreset mode of a vector environment, which Gymnasium has since 1.1."""

import gymnasium

try:
    from gymnasium.vector import AutoresetMode
except ImportError as error:
    raise ImportError(
        "the vector environments of irs_gym need gymnasium>=1.1, and this is "
        f"{gymnasium.__version__}: put single environments (gymnasium.make) into "
        "gymnasium.vector.SyncVectorEnv instead"
    ) from error

__all__ = ["AutoresetMode", "checked_mode"]


def checked_mode(mode: str | AutoresetMode) -> AutoresetMode:
    """The autoreset mode of that name; a ``ValueError`` lists the known ones for an unknown one."""
    if isinstance(mode, AutoresetMode):
        return mode

    for each in AutoresetMode:
        if isinstance(mode, str) and mode in (each.value, each.name, each.name.lower()):
            return each

    raise ValueError(
        f"autoreset_mode={mode!r} must be one of {[each.value for each in AutoresetMode]}"
    )
