"""Tests of the training code: python -m unittest test_training (in this folder)."""

import io
import math
import os
import tempfile
import unittest

import numpy as np
import torch

import data
import faults
import import_weights
import photo_losses
import procedural
import relief
from faults import Draws, Ranges
from networks import PHOTO_CHANNELS, OnePhoto, PhotoNetwork
from renderer import (
    decode_maps,
    encode_maps,
    in_window,
    lobe_scale,
    photo_configurations,
    random_configurations,
    render,
)
from textures import noise

MODELS = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "models")


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def uniform_maps(batch=1, size=32, kd=0.3, ks=0.04, roughness=0.4, slope=0.0):
    one = torch.ones(batch, 1, size, size)
    return encode_maps(slope * one.expand(-1, 2, -1, -1), kd * one.expand(-1, 3, -1, -1), ks * one.expand(-1, 3, -1, -1), roughness * one)


def only(**faults_on):
    return Ranges(**{**vars(Ranges.none()), **faults_on})


class DeepBlocks(unittest.TestCase):
    def test_begin_as_the_identity(self):
        """A checkpoint without the blocks goes on as it was."""
        torch.manual_seed(3)
        plain = PhotoNetwork(rounds=2).eval()
        deep = PhotoNetwork(rounds=2, deep=True).eval()
        self.assertEqual(deep.options["deep"], True)
        missing, unexpected = deep.load_state_dict(plain.state_dict(), strict=False)
        self.assertTrue(missing and all(name.startswith("deep") for name in missing))
        self.assertFalse(unexpected)
        photo = torch.rand(1, PHOTO_CHANNELS, 64, 32)
        with torch.no_grad():
            self.assertTrue(torch.equal(OnePhoto(plain)(photo), OnePhoto(deep)(photo)))


class Saturation(unittest.TestCase):
    def test_may_be_unmarked(self):
        e = uniform_maps(8, kd=0.8)
        camera, light = photo_configurations(8)
        ranges = only(clip_chance=1.0, clip=(0.1, 0.1), clip_low_chance=0.0, clip_share_chance=0.0)
        radiance, _, marked, _, _ = faults.photograph(e, camera, light, ranges, generator=seeded())
        self.assertTrue(bool((radiance.amax((1, 2, 3)) <= 0.1001).all()) and float(marked.amin()) == 1)
        hidden = Ranges(**{**vars(ranges), "unmarked_chance": 1.0})
        radiance, _, marked, _, _ = faults.photograph(e, camera, light, hidden, generator=seeded())
        self.assertTrue(bool((radiance.amax((1, 2, 3)) <= 0.1001).all()) and float(marked.amax()) == 0)


class Prints(unittest.TestCase):
    def test_are_flat_whatever_their_pattern(self):
        for name in ("printed", "foil"):
            for seed in range(4):
                e = torch.from_numpy(procedural.generate(name, 128, seed))
                slope, kd, ks, _ = decode_maps(e[None])
                self.assertLess(float((slope**2).sum(1).mean().sqrt()), 0.2, (name, seed))
                self.assertGreater(float((kd + ks).std((2, 3)).max()), 0.005, (name, seed))


class Lobe(unittest.TestCase):
    def test_distribution_of_normals_is_normalised(self):
        # integral of D cos over the hemisphere; midpoints in t = cos² make it 1/2 mean(pi D) dt
        t = (torch.arange(4_000_000, dtype=torch.float64) + 0.5) / 4_000_000
        for roughness in (0.15, 0.3, 0.6, 0.95):
            for exponent in (1.5, 2.0, 2.5):
                a2 = torch.tensor(roughness**4, dtype=torch.float64)
                d = lobe_scale(a2, torch.tensor(exponent)) / ((a2 - 1) * t + 1) ** exponent
                self.assertAlmostEqual(float(d.mean()), 1.0, delta=2e-3)

    def test_exponent_two_is_ggx(self):
        e = uniform_maps(2, roughness=0.3)
        camera, light = photo_configurations(2)
        two = torch.full((2, 1, 1, 1), 2.0)
        a, b = render(e, camera[:, None], light[:, None]), render(e, camera[:, None], light[:, None], two)
        self.assertLess(float((a / b - 1).abs().max()), 1e-4)

    def test_same_width_lobes_fall_to_half_at_the_same_angle(self):
        ggx = 0.4**4
        sin2 = (math.sqrt(2) - 1) * ggx / (1 - ggx)
        for exponent in (1.5, 2.0, 2.5):
            a2 = float(faults.same_width_roughness(torch.tensor(0.4), torch.tensor(exponent))) ** 4
            fall = (((a2 - 1) * (1 - sin2) + 1) / a2) ** exponent
            self.assertAlmostEqual(fall, 2.0, places=4)


class Window(unittest.TestCase):
    def test_part_of_a_sample_is_rendered_as_in_the_whole(self):
        torch.manual_seed(0)
        e = torch.rand(1, 9, 64, 64) * 1.6 - 0.8
        camera, light = torch.tensor([[0.3, -0.2, 2.0]]), torch.tensor([[0.1, 0.4, 1.7]])
        whole = render(e, camera[:, None], light[:, None])
        # rows 16 to 32 and columns 8 to 24: centre (-0.5, 0.25), a quarter of the width
        window = (torch.tensor([[-0.5, 0.25]]), 0.25)
        part = render(e[..., 16:32, 8:24], in_window(camera, *window)[:, None], in_window(light, *window)[:, None])
        # differences of positions are rounded differently; highlights of roughness 0.1 enlarge that
        self.assertLess(float((part / whole[..., 16:32, 8:24] - 1).abs().max()), 2e-3)


class Faults(unittest.TestCase):
    def photograph(self, e, ranges, seed=0):
        torch.manual_seed(1)
        camera, light = photo_configurations(len(e))
        return camera, light, faults.photograph(e, camera, light, ranges, generator=seeded(seed))

    def test_no_faults_are_the_rendering(self):
        e = uniform_maps(3)
        camera, light, (radiance, weight, saturated, told, flash) = self.photograph(e, Ranges.none())
        torch.testing.assert_close(radiance, render(e, camera[:, None], light[:, None])[:, 0], rtol=2e-4, atol=1e-6)
        self.assertEqual(float(weight.min()), 1.0)
        self.assertEqual(float(saturated.max()), 0.0)
        torch.testing.assert_close(told, camera)
        torch.testing.assert_close(flash, light)

    def test_the_seed_decides(self):
        e = uniform_maps(4)
        _, _, first = self.photograph(e, Ranges(), 3)
        _, _, same = self.photograph(e, Ranges(), 3)
        _, _, other = self.photograph(e, Ranges(), 4)
        for a, b in zip(first, same):
            self.assertTrue(torch.equal(a, b))
        self.assertFalse(torch.equal(first[0], other[0]))
        self.assertTrue(all(torch.isfinite(x).all() and (x >= -1e9).all() for x in first))

    def test_gain_has_the_stated_spread(self):
        e = uniform_maps(800, 8)
        clean = self.photograph(e, Ranges.none())[2][0]
        gain = (self.photograph(e, only(gain_sigma=0.05))[2][0] / clean).mean((1, 2, 3)).log()
        self.assertAlmostEqual(float(gain.std()), 0.05, delta=0.005)
        gain = (self.photograph(e, only(unknown_gain_chance=1.0))[2][0] / clean).mean((1, 2, 3))
        self.assertGreater(float(gain.min()), 0.6 - 1e-4)
        self.assertLess(float(gain.max()), 1.6 + 1e-4)
        self.assertAlmostEqual(float(gain.log().mean()), 0.5 * math.log(0.6 * 1.6), delta=0.04)

    def test_flash_is_told_off_by_the_stated_range(self):
        e = uniform_maps(2000, 8)
        camera, light, out = self.photograph(e, only(flash_chance=0.5))
        off = (out[4] - light).norm(dim=1)
        self.assertAlmostEqual(float((off > 0).float().mean()), 0.5, delta=0.04)
        self.assertLess(float(off.max()), 0.25 * 4.5)
        torch.testing.assert_close(out[3], camera)

    def test_clipped_share_is_what_was_drawn(self):
        e = uniform_maps(300, 32, roughness=0.25)
        _, _, (radiance, _, saturated, _, _) = self.photograph(
            e, only(clip_chance=1.0, clip_share_chance=1.0, clip_share=(0.1, 0.1001))
        )
        top = radiance.amax((1, 2, 3))
        share = (radiance.amax(1) >= top[:, None, None] * (1 - 1e-6)).float().mean((1, 2))
        self.assertAlmostEqual(float(share.median()), 0.1, delta=0.01)
        # the mark lies where a channel is clipped, or next to it
        self.assertTrue(((saturated > 0).float().mean((1, 2, 3)) >= share - 1e-3).all())

    def test_displacement_and_blur_are_what_they_say(self):
        ramp = torch.arange(32.0).expand(2, 3, 32, 32).contiguous()
        offset = torch.zeros(2, 2, 32, 32)
        offset[:, 0] = 0.5
        moved = faults.displace(ramp, offset)
        torch.testing.assert_close(moved[..., 2:-2], ramp[..., 2:-2] + 0.5, rtol=0, atol=1e-4)
        dot = torch.zeros(2, 3, 33, 33)
        dot[..., 16, 16] = 1
        t = torch.arange(33.0) - 16
        for sigma in (0.5, 0.9):
            b = faults.blur(dot, torch.full((2, 1, 1, 1), sigma))[0, 0]
            self.assertAlmostEqual(float(b.sum()), 1.0, delta=1e-5)
            # a Gaussian of half a texel, sampled at texels, is a seventh narrower
            self.assertAlmostEqual(float((b.sum(0) * t * t).sum()), sigma**2, delta=0.04)

    def test_registration_error_is_at_most_half_a_texel(self):
        x = torch.linspace(0.2, 0.8, 64)
        picture = x.expand(200, 3, 64, 64).contiguous()
        draws = Draws(200, torch.device("cpu"), seeded())
        moved = faults.optics(picture, draws, only(shift_chance=1.0))
        texels = (moved - picture)[..., 2:-2] / (x[1] - x[0])
        self.assertLessEqual(float(texels.abs().max()), 0.5 + 1e-3)
        self.assertGreater(float(texels.abs().mean()), 0.1)

    def test_tone_curve_keeps_middle_gray_and_rises(self):
        y = torch.linspace(0.01, 1, 50).view(1, 1, 1, -1)
        for exponent, shoulder in ((0.8, 0.0), (1.2, 0.8), (1.0, 0.0)):
            a, b = torch.tensor(exponent).view(1, 1, 1, 1), torch.tensor(shoulder).view(1, 1, 1, 1)
            out = faults.tone_curve(y, a, b)
            self.assertTrue((out.diff() > 0).all())
            self.assertAlmostEqual(float(faults.tone_curve(torch.full_like(a, 0.18), a, b)), 0.18, places=5)
        torch.testing.assert_close(out, y)

    def test_jpeg_is_as_lossy_as_a_jpeg_file(self):
        from PIL import Image

        rng = np.random.default_rng(0)
        picture = np.stack([0.5 + 0.12 * noise(128, rng, 1.0, low=3) + 0.03 * noise(128, rng, 0.3) for _ in range(3)])
        picture = (picture.clip(0, 1) * 255).round().astype(np.float32) / 255
        for quality in (70, 85, 95):
            ours = faults.jpeg(torch.tensor(picture)[None], torch.full((1, 1, 1, 1), float(quality)))[0].numpy()
            file = io.BytesIO()
            Image.fromarray((picture.transpose(1, 2, 0) * 255).astype(np.uint8)).save(file, "JPEG", quality=quality, subsampling=2)
            theirs = np.asarray(Image.open(file), np.float32).transpose(2, 0, 1) / 255
            rms = lambda a: float(np.sqrt(((a - picture) ** 2).mean()))
            self.assertAlmostEqual(rms(ours) / rms(theirs), 1.0, delta=0.1)
            self.assertLess(float(np.sqrt(((ours - theirs) ** 2).mean())), 0.5 * rms(theirs))


class Materials(unittest.TestCase):
    def test_licences(self):
        for text in ("CC0-1.0", "CC0-1.0 (per repo)", "CC-BY-3.0", "project", "GPL-2+ or CC0-1.0"):
            self.assertTrue(data.is_permissive(text), text)
        for text in ("CC-BY-SA-3.0", "GPL-2+", "CC-BY-SA / CC0 / GPL (see debian copyright)", "CC-BY-SA-3.0 or GPL-2", "unknown", ""):
            self.assertFalse(data.is_permissive(text), text)

    def test_gathered_crops_are_the_sliced_ones(self):
        torch.manual_seed(0)
        levels = torch.rand(3, 9, 64, 64).half(), torch.rand(3, 9, 32, 32).half()
        # (level, y, x, side, quarter turns, mirrored)
        for level, y, x, side, turns, flip in ((0, 3, 5, 32, 1, True), (0, 0, 20, 44, 3, False), (1, 2, 7, 24, 0, True), (0, 9, 9, 32, 2, False)):
            sliced = data.slice_crop(levels[level][1], y, x, side, 32, turns, flip)
            place = torch.tensor([[1, y, x, side, turns, flip]])
            gathered = data.gather_crops(levels[level], place, 32)[0]
            self.assertLess(float((sliced - gathered).abs().max()), 1e-5)


    def test_pool_gives_the_same_crops_by_either_way(self):
        with tempfile.TemporaryDirectory() as folder:
            writer = data.PackWriter(folder, 2)
            torch.manual_seed(0)
            for i in range(2):
                writer.add(f"m{i}", "P", "project", torch.rand(9, data.SIZE, data.SIZE))
            writer.close()
            pool = data.MaterialPool([folder], subset="all")
            self.assertEqual(pool.licences(), {"project": 2})
            picks = np.array([0, 1, 1, 0])
            sliced = pool.crops(picks, 96, np.random.default_rng(0), 256)
            pool.stacked = [torch.cat([p[k] for p in pool.packs]) for k in (0, 1)]
            gathered = pool.crops(picks, 96, np.random.default_rng(0), 256)
            # positions up to 512 have seven digits, and these maps are white noise
            self.assertLess(float((sliced - gathered).abs().max()), 1e-4)

    def test_packs_join_when_they_are_complete(self):
        with tempfile.TemporaryDirectory() as folder:
            def pack(name, tier, count):
                writer = data.PackWriter(os.path.join(folder, name), count)
                for i in range(count):
                    writer.add(f"{name}{i}", tier, "project", torch.zeros(9, data.SIZE, data.SIZE))
                return writer

            pack("first", "A", 1).close()
            late = pack("late", "P", 3)
            folders = [os.path.join(folder, n) for n in ("first", "late")]
            pool = data.MaterialPool(folders, subset="all", real_share=0.4)
            self.assertEqual((len(pool), pool.waiting), (1, folders[1:]))
            late.close()
            pool.refresh()
            self.assertEqual((len(pool), pool.waiting), (4, []))
            self.assertTrue(np.allclose(pool.probability, [0.4, 0.2, 0.2, 0.2]))
            self.assertEqual(list(pool.numbers), [0, 1, 2, 3])

    def test_printed_blends_have_the_relief_of_one_and_the_colours_of_the_other(self):
        first, second = torch.zeros(4, 9, 16, 16), torch.ones(4, 9, 16, 16)
        blend = data.blend_maps(first, second, printed=1.0)
        self.assertTrue(bool((blend[:, [0, 1, 8]] == 0).all() and (blend[:, 2:8] == 1).all()))

    def test_generated_materials_are_physical(self):
        for name in procedural.FAMILIES:
            slope, kd, ks, roughness = decode_maps(torch.from_numpy(procedural.generate(name, 64, 3)))
            self.assertLessEqual(float((kd + ks).max()), 1 + 1e-4, name)
            self.assertGreaterEqual(float(roughness.min()), 0.05 - 1e-4, name)
            self.assertLess(float(slope.mean((1, 2)).abs().max()), 0.25, name)
        for name in relief.FAMILIES:
            rms = [float((decode_maps(torch.from_numpy(procedural.generate(name, 128, s)))[0] ** 2).sum(0).mean().sqrt()) for s in range(4)]
            self.assertGreater(max(rms), 0.08, name)


class Losses(unittest.TestCase):
    def setUp(self):
        torch.manual_seed(0)
        self.truth = uniform_maps(2, 64)
        self.truth[:, :2] = 0.15 * torch.randn(2, 2, 64, 64)

    def test_no_difference_costs_nothing(self):
        lights = photo_losses.distant_lights(2, 4, torch.device("cpu"))
        camera, light = random_configurations(2, 1, 1, 1)
        for loss in photo_losses.photo_losses(self.truth, self.truth, camera, light, lights):
            self.assertLess(float(loss), 1e-6)

    def test_flat_relief_costs_the_amplitude_that_it_lacks(self):
        for factor in (0.5, 2.0):
            scaled = self.truth.clone()
            scaled[:, :2] *= factor
            cost = float(photo_losses.amplitude_loss(scaled, self.truth))
            self.assertAlmostEqual(cost, abs(math.log(factor)), delta=0.02)

    def test_shading_does_not_see_albedo(self):
        other = self.truth.clone()
        other[:, 2:] = -0.5
        lights = photo_losses.distant_lights(2, 4, torch.device("cpu"))
        self.assertEqual(float(photo_losses.shading_loss(other, self.truth, lights)), 0.0)

    def test_spread_is_least_at_the_true_deviation(self):
        found = self.truth + 0.1 * torch.randn_like(self.truth)
        cost = lambda s: float(photo_losses.spread_loss(torch.full_like(found, math.log(s)), found, self.truth))
        self.assertLess(cost(0.1), min(cost(0.09), cost(0.11)))


class Weights(unittest.TestCase):
    def test_exported_graphs_become_networks_again(self):
        for name in import_weights.NETWORKS:
            self.assertLess(import_weights.load_exported(MODELS, name)[1], import_weights.TOLERANCE)

    def test_second_head_does_not_move_the_first(self):
        torch.manual_seed(0)
        network = PhotoNetwork(spread=True, rounds=2)
        maps, log_sigma = OnePhoto(network)(torch.rand(1, PHOTO_CHANNELS, 64, 32))
        self.assertEqual(log_sigma.shape, maps.shape)
        photo_losses.spread_loss(log_sigma, maps, torch.zeros_like(maps)).backward()
        moved = {n for n, p in network.named_parameters() if p.grad is not None and float(p.grad.abs().max()) > 0}
        self.assertTrue(moved and all(n.startswith("spread") for n in moved), moved)


if __name__ == "__main__":
    unittest.main()
