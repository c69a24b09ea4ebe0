import json
import shutil

import pytest
import torch

from cnca.core.errors import GeneratorError
from cnca.gen.pipeline import load_pipeline
from cnca.gen.sampling import DiffusionTextureGenerator


def refusal(folder) -> str:
    with pytest.raises(GeneratorError) as caught:
        load_pipeline(folder)
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_folder_saved_by_diffusers_paints_what_the_parts_paint(tiny, tiny_folder):
    loaded = DiffusionTextureGenerator.load(tiny_folder, tokens=2, steps=2)
    parts = DiffusionTextureGenerator(tiny, tokens=2, steps=2)
    one, two = (
        g.generate(g.encode("zebra strips"), None, torch.Generator().manual_seed(0))
        for g in (loaded, parts)
    )
    torch.testing.assert_close(one, two)


def test_half_precision_weights_are_read_as_float32(tiny, tiny_folder):
    tiny.unet.half().save_pretrained(tiny_folder / "unet")
    assert load_pipeline(tiny_folder).unet.dtype == torch.float32


def test_missing_folder(tmp_path):
    assert "no such folder" in refusal(tmp_path / "nowhere")


def test_folder_without_index(tmp_path):
    assert "no model_index.json" in refusal(tmp_path)


@pytest.mark.parametrize("text", ["{", "[]", "{}", "3"])
def test_index_that_is_no_index(tmp_path, text):
    (tmp_path / "model_index.json").write_text(text)
    assert "not a diffusers index" in refusal(tmp_path)


def test_other_architectures(tiny_folder):
    index_file = tiny_folder / "model_index.json"
    index = json.loads(index_file.read_text())
    index_file.write_text(json.dumps(index | {"_class_name": "FluxPipeline"}))
    assert "FluxPipeline, not StableDiffusionPipeline" in refusal(tiny_folder)
    index_file.write_text(json.dumps(index | {"vae": ["diffusers", "AutoencoderTiny"]}))
    assert "vae is" in refusal(tiny_folder)


def test_missing_and_truncated_weights(tiny_folder):
    weights = tiny_folder / "vae" / "diffusion_pytorch_model.safetensors"
    weights.write_bytes(weights.read_bytes()[:1000])
    assert "cannot load the pipeline" in refusal(tiny_folder)
    shutil.rmtree(tiny_folder / "vae")
    assert "cannot load the pipeline" in refusal(tiny_folder)


def test_pickled_weights_are_not_opened(tiny, tiny_folder):
    folder = tiny_folder / "unet"
    shutil.rmtree(folder)
    tiny.unet.save_pretrained(folder, safe_serialization=False)
    assert "cannot load the pipeline" in refusal(tiny_folder)
