"""Facts of where a result comes from."""

import platform
from pathlib import Path

import pytest

from agents.runs import provenance


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("model\t\t: 1\nmodel name\t: AMD EPYC: 7B13\nmodel name\t: other\n", "AMD EPYC: 7B13"),
        ("Features\t: fp\n", "aarch64"),  # many an ARM tells no name
        (None, "aarch64"),
    ],
)
def test_the_processor_is_cited_by_its_name_or_else_by_its_architecture(monkeypatch, text, wanted):
    def read_text(path, encoding):
        if text is None:
            raise FileNotFoundError(path)
        return text

    monkeypatch.setattr(Path, "read_text", read_text)
    monkeypatch.setattr(platform, "processor", lambda: "")
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    assert provenance.processor() == wanted
