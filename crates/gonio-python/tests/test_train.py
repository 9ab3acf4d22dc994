"""Training of models on small synthetic data, in memory and in folders."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import gonio


def lights() -> list[np.ndarray]:
    studio = gonio.studio_light(16)
    y, x = np.mgrid[:16, :32]
    return [np.roll(studio, turn, axis=1) * (1 + 0.5 * np.sin(0.4 * x + 0.3 * i * y))[:, :, None] for i, turn in enumerate([0, 5, 11])]


def materials() -> dict[str, gonio.Brdf]:
    def make(diffuse: float, width: float) -> gonio.Brdf:
        return gonio.Brdf.of(lambda h, d: diffuse / np.pi + np.exp(-((h / width) ** 2)) / width)

    return {"matt": make(0.3, 0.6), "satin": make(0.2, 0.3), "gloss": make(0.05, 0.15)}


@pytest.fixture(scope="module")
def lighting() -> gonio.ModelPart:
    return gonio.train_lighting(lights(), grid=16, rotations=2)


@pytest.fixture(scope="module")
def basis() -> gonio.ModelPart:
    return gonio.train_reflectance(materials(), rank=2, starts=2)


@pytest.fixture(scope="module")
def posterior() -> gonio.ModelPart:
    return gonio.train_posterior(lights()[:1], materials(), views=1, group_materials=4, steps=2)


def test_a_trained_model_can_be_used(small, tmp_path, lighting, basis, posterior):
    assert "3 maps" in lighting.provenance and set(basis.errors) == {"matt", "satin", "gloss"}
    model = gonio.train_model(lighting, basis, posterior)
    assert model.has_posterior and model.largest_grid == 16 and "3 materials" in model.provenance
    model.write(str(tmp_path / "x.model"))
    # Two steps teach too little to reproduce the photograph.
    found = gonio.infer(small, model=tmp_path / "x.model", grid=8, pictures=False, force=True)
    assert found.result["model"]["provenance"] == model.provenance
    assert np.array_equal(gonio.infer(small, model=model, grid=8, pictures=False, force=True).brdf.table, found.brdf.table)
    # Pickled results contain the trained model.
    assert pickle.loads(pickle.dumps(found)).draw(2).shape == (2, 90, 90)
    # The untrained parts are those of the embedded model.
    assert gonio.train_model(posterior=posterior).largest_grid == gonio.Model.embedded().largest_grid


def test_colours_of_a_model_are_trained_again(small, lighting, basis, posterior):
    model = gonio.train_model(lighting, basis, posterior)
    recoloured = gonio.train_colours(lights()[:2], materials(), model=model)
    assert recoloured.provenance != model.provenance
    assert recoloured.provenance.endswith("from 3 materials in 2 maps")
    assert gonio.infer(small, model=recoloured, grid=8, pictures=False, force=True).result["model"]["provenance"] == recoloured.provenance


# The fit to the embeddings of the model takes a minute, whatever the number of steps.
@pytest.mark.slow
def test_a_training_begins_with_a_model(posterior):
    again = gonio.train_posterior(lights()[:1], materials(), views=1, group_materials=2, steps=1, initial=gonio.train_model(posterior=posterior))
    assert again.provenance.endswith(f"from the network of: {posterior.provenance}")


def test_refuses_models_without_a_posterior(small, lighting, basis):
    model = gonio.train_model(lighting, basis)
    with pytest.raises(gonio.GonioError, match="model: has no posterior of materials, which the colour model requires"):
        gonio.train_colours(lights()[:1], materials(), model=model)
    with pytest.raises(gonio.GonioError, match="the model: has no posterior of materials"):
        gonio.infer(small, model=model, grid=8, pictures=False)
    with pytest.raises(gonio.GonioError, match="no posterior"):
        gonio.train_posterior(lights()[:1], materials(), views=1, group_materials=2, steps=1, initial=model)


def test_progress_of_a_training_is_reported():
    told = []
    gonio.train_lighting(lights(), grid=8, rotations=1, progress=lambda stage, x: told.append(stage))
    assert told and set(told) == {"reading lights"}


def test_trains_from_folders_and_files(tmp_path):
    (tmp_path / "lights").mkdir()
    (tmp_path / "materials").mkdir()
    for i, light in enumerate(lights()):
        gonio.write_image(tmp_path / "lights" / f"{i}.exr", light)
    for name, brdf in materials().items():
        brdf.write(tmp_path / "materials" / f"{name}.binary")
    by_folder = gonio.train_lighting(tmp_path / "lights", grid=16, rotations=2)
    assert by_folder.data == gonio.train_lighting(lights(), grid=16, rotations=2).data
    basis = gonio.train_reflectance(tmp_path / "materials", rank=2, starts=2)
    by_folder.write(tmp_path / "light.model")
    model = gonio.train_model(tmp_path / "light.model", basis)
    assert not model.has_posterior


def test_rejects_invalid_training_data(tmp_path):
    with pytest.raises(gonio.GonioError, match="grid 17: must be a power of two from 8 to 512"):
        gonio.train_lighting(lights(), grid=17)
    with pytest.raises(gonio.GonioError, match="rotations 0"):
        gonio.train_lighting(lights(), rotations=0)
    with pytest.raises(gonio.GonioError, match="the lights: there are no environment maps"):
        gonio.train_lighting([])
    with pytest.raises(gonio.GonioError, match="light 1: a lat-long map must be twice as wide as high"):
        gonio.train_lighting([lights()[0], np.ones((4, 4, 3))])
    with pytest.raises(gonio.GonioError, match="contains no .hdr, .exr or .pfm files"):
        gonio.train_lighting(tmp_path)
    with pytest.raises(gonio.MissingFileError, match="cannot list this folder"):
        gonio.train_lighting(tmp_path / "none")
    with pytest.raises(gonio.GonioError, match="rank 4: must be from 1 to 3, the number of materials in the list"):
        gonio.train_reflectance(materials(), rank=4)
    with pytest.raises(gonio.GonioError, match='channel "white"'):
        gonio.train_reflectance(materials(), channel="white")
    part = gonio.train_lighting(lights(), grid=8, rotations=1)
    with pytest.raises(gonio.GonioError, match="the lighting: .*a light prior alone"):
        gonio.train_model(part, part)
