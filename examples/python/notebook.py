# %% [markdown]
# # From photographs to maps, step by step
# A notebook as a Python file: Jupyter (with jupytext), VS Code, PyCharm and Spyder show its cells. It needs the packages
# svbrdf and matplotlib, and is started in the root folder of the repository. `README.md` beside it has the pictures.

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import svbrdf

CAPTURE = Path("examples/captures/tile")
# A folder that gets the pictures, for programs without a screen.
PICTURES = os.environ.get("PICTURES")


def screen(linear: np.ndarray) -> np.ndarray:
    """Linear colours as a screen shows them."""
    return np.clip(linear, 0, 1) ** (1 / 2.2)


def show(figure: Figure, name: str) -> None:
    if PICTURES:
        figure.savefig(Path(PICTURES) / f"{name}.jpg", dpi=90)
    plt.show()


# %% [markdown]
# ## The photographs
# The capture is rendered from known maps, so that the errors of the result are known. For photographs of your own, give a
# list of files to `svbrdf.fit`.

# %%
capture = svbrdf.Capture.load(CAPTURE)
truth = svbrdf.Maps.load(CAPTURE / "truth", sample_mm=capture.sample_mm)
photos = [file.read() for file in capture.photos]
print(f"{len(photos)} photographs of {photos[0].width} x {photos[0].height} px, sample of {capture.sample_mm} mm")

figure, axes = plt.subplots(1, 4, figsize=(12, 2.6), layout="constrained")
for axis, photo in zip(axes, photos):
    axis.imshow(screen(photo.linear()[::4, ::4]))
    axis.axis("off")
show(figure, "photographs")

# %% [markdown]
# ## One photograph after the other
# The session has maps after the first photograph, and better ones after each further one. How far off they are is measured
# by rendering both them and the true maps with a camera and a light of no photograph.

# %%
VIEW = {"camera_mm": (40.0, -60.0, 250.0), "light_mm": (-90.0, 70.0, 180.0)}
after: dict[int, svbrdf.Maps] = {}
with svbrdf.Session.of_capture(capture) as session:
    for count, photo in enumerate(photos[:5], start=1):
        outcome = session.add_photo(photo)
        if not outcome:
            print(outcome.message)
        session.wait()
        after[count] = session.snapshot_with_uncertainty()

rendered = truth.render(**VIEW)
# The true maps have twice the texels a side.
height, width, _ = rendered.shape
expected = screen(rendered.reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3)))
for count, maps in after.items():
    error = np.sqrt(np.mean((screen(maps.render(**VIEW)) - expected) ** 2))
    print(f"{count} photographs: a new rendering is off by {error:.3f}")

# %% [markdown]
# ## The maps

# %%
def pictures(maps: svbrdf.Maps) -> dict[str, np.ndarray]:
    return {
        "normal": maps.normal / 2 + 0.5,
        "diffuse": screen(maps.diffuse),
        "specular": screen(maps.specular),
        "roughness": np.repeat(maps.roughness.reshape(*maps.normal.shape[:2], 1), 3, axis=2),
    }


rows = {"1 photograph": after[1], "5 photographs": after[5], "true": truth}
figure, axes = plt.subplots(3, 4, figsize=(12, 9.3), layout="constrained")
for line, (label, maps) in zip(axes, rows.items()):
    for axis, (name, picture) in zip(line, pictures(maps).items()):
        axis.imshow(np.clip(picture, 0, 1))
        axis.set_xticks([])
        axis.set_yticks([])
        axis.set_title(name if maps is after[1] else "")
    line[0].set_ylabel(label)
show(figure, "maps")

# %% [markdown]
# ## How certain they are
# Each map comes with the standard deviation that is to be expected, texel by texel.

# %%
deviations = after[5].deviations
assert deviations is not None
figure, axes = plt.subplots(1, len(deviations), figsize=(12, 2.9), layout="constrained")
for axis, (name, deviation) in zip(axes, deviations.items()):
    values = deviation.reshape(*deviation.shape[:2], -1).mean(axis=2)
    shown = axis.imshow(values, cmap="magma", vmin=0, vmax=np.percentile(values, 99))
    axis.set_title(name)
    axis.axis("off")
    figure.colorbar(shown, ax=axis)
show(figure, "deviations")

# %% [markdown]
# ## New light

# %%
figure, axes = plt.subplots(1, 4, figsize=(12, 3.1), layout="constrained")
for axis, angle in zip(axes, (0, 90, 180, 270)):
    x, y = 120 * np.cos(np.radians(angle)), 120 * np.sin(np.radians(angle))
    axis.imshow(screen(after[5].render(camera_mm=(0, 0, 300), light_mm=(x, y, 160))))
    axis.set_title(f"light at {angle}°")
    axis.axis("off")
show(figure, "light")

# %% [markdown]
# ## Into other programs

# %%
files = after[5].package(["glb", "blender"])
for name, data in files.items():
    print(f"{name}: {len(data)} bytes")
# after[5].export("material", ["glb", "blender"]) writes them to a folder.
