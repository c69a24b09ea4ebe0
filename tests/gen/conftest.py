"""A tiny random pipeline, and its folder."""

from pathlib import Path

import pytest
import torch

from cnca.gen.pipeline import Pipeline
from tests.gen.tiny import save_pipeline, tiny_pipeline


@pytest.fixture(autouse=True)
def _one_thread():
    torch.set_num_threads(1)


@pytest.fixture
def tiny() -> Pipeline:
    return tiny_pipeline()


@pytest.fixture
def tiny_folder(tiny: Pipeline, tmp_path: Path) -> Path:
    return save_pipeline(tiny, tmp_path / "tiny")
