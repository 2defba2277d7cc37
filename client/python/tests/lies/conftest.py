"""A server that answers what a test wants."""
from __future__ import annotations

from typing import Iterator

import pytest

from .liar import Liar, serve


@pytest.fixture(scope="session")
def running_liar() -> Iterator[tuple[Liar, str]]:
    """A running one, and its address."""
    yield from serve()


@pytest.fixture()
def liar(running_liar: tuple[Liar, str]) -> tuple[Liar, str]:
    """The same without answers."""
    running_liar[0].answers = {}
    return running_liar
