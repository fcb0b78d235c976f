//! The maps.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::ndarray::{Ix2, Ix3};
use numpy::{PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use svbrdf::export::{self, ExportOptions, Format, Package, TextureFormat};
use svbrdf::observation::View;
use svbrdf::svbrdf::gltf::{self, Shown};
use svbrdf::svbrdf::{MAX_SLOPE, lobe};
use svbrdf::uncertainty::Uncertainty;
use svbrdf::{Svbrdf, render};

use crate::arrays::{array, floats, size};
use crate::errors::{argument, choice, detached};

/// Normal, diffuse albedo, specular albedo and roughness of every texel.
///
/// Row 0 is the sample's +Y edge, column 0 its -X edge. Every access to ``normal``, ``diffuse``, ``specular``,
/// ``roughness``, ``anisotropy``, ``coat``, ``sheen`` makes a new array of ``float32``.
#[pyclass(frozen, module = "svbrdf")]
pub struct Maps {
    maps: Arc<Svbrdf>,
    uncertainty: Option<Arc<Uncertainty>>,
    sample_mm: [f32; 2],
    photos: Py<PyTuple>,
}

impl Maps {
    /// Maps of a sample of that size, with how far they may be off.
    pub fn of(
        py: Python<'_>,
        maps: Arc<Svbrdf>,
        uncertainty: Option<Arc<Uncertainty>>,
        sample_mm: [f32; 2],
    ) -> Self {
        Self { maps, uncertainty, sample_mm, photos: PyTuple::empty(py).unbind() }
    }

    fn shape(&self) -> [usize; 2] {
        [self.maps.height(), self.maps.width()]
    }

    /// Texel by texel from three planes.
    fn colours<'py>(&self, py: Python<'py>, planes: [&[f32]; 3]) -> Bound<'py, PyArray3<f32>> {
        self.texels(py, |i| planes.map(|plane| plane[i]))
    }

    /// Texel by texel from its number.
    fn texels<'py, const CHANNELS: usize>(
        &self,
        py: Python<'py>,
        texel: impl FnMut(usize) -> [f32; CHANNELS],
    ) -> Bound<'py, PyArray3<f32>> {
        let [height, width] = self.shape();
        let values = (0..width * height).flat_map(texel).collect();
        array(py, Ix3(height, width, CHANNELS), values)
    }

    fn plane<'py>(&self, py: Python<'py>, values: &[f32]) -> Bound<'py, PyArray2<f32>> {
        let [height, width] = self.shape();
        array(py, Ix2(height, width), values.to_vec())
    }

    /// Accepted photographs that they come from, where that is known.
    fn count(&self, py: Python<'_>) -> PyResult<Option<u32>> {
        let mut count = 0;
        for photograph in self.photos.bind(py) {
            count += u32::from(photograph.getattr("accepted")?.is_truthy()?);
        }
        Ok((count > 0).then_some(count))
    }

    fn packed(
        &self,
        py: Python<'_>,
        formats: Vec<String>,
        tile: bool,
        metallic: bool,
        texture: &str,
        max_size: Option<usize>,
    ) -> PyResult<Package> {
        let names = Format::ALL.map(Format::name);
        let formats = formats
            .iter()
            .map(|name| choice("formats", name, Format::from_name(name), &names))
            .collect::<PyResult<Vec<_>>>()?;
        let textures = TextureFormat::ALL.map(TextureFormat::name);
        let texture = choice("texture", texture, TextureFormat::from_name(texture), &textures)?;
        let photographs = self.count(py)?;
        let sample_mm = self.sample_mm;
        let options =
            ExportOptions { formats, sample_mm, metallic, tile, texture, max_size, photographs };
        detached(py, || export::export(&self.maps, &options))
    }
}

#[pymethods]
impl Maps {
    /// Maps of arrays: ``normal`` (height, width, 3), unit vectors, Y up; ``diffuse`` and ``specular`` (height, width, 3),
    /// linear, 0 to 1; ``roughness`` (height, width), 0 to 1. Slopes are limited to 3 (71.6 degrees). Optional lobes:
    /// ``anisotropy`` (height, width, 3), cosine and sine of the direction and strength; ``coat`` (height, width, 2), weight
    /// and roughness; ``sheen`` (height, width, 4), linear RGB and roughness.
    ///
    /// >>> import numpy as np
    /// >>> flat = np.zeros((2, 2, 3)); flat[..., 2] = 1
    /// >>> gray = np.full((2, 2, 3), 0.5)
    /// >>> maps = Maps.from_arrays(flat, gray, gray * 0.08, np.full((2, 2), 0.4), sample_mm=(100, 100))
    /// >>> maps.roughness
    /// array([[0.4, 0.4],
    ///        [0.4, 0.4]], dtype=float32)
    #[staticmethod]
    #[pyo3(signature = (normal, diffuse, specular, roughness, *, sample_mm, anisotropy = None, coat = None, sheen = None))]
    fn from_arrays(
        py: Python<'_>,
        normal: &Bound<'_, PyAny>,
        diffuse: &Bound<'_, PyAny>,
        specular: &Bound<'_, PyAny>,
        roughness: &Bound<'_, PyAny>,
        sample_mm: (f32, f32),
        anisotropy: Option<&Bound<'_, PyAny>>,
        coat: Option<&Bound<'_, PyAny>>,
        sheen: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let optional = [
            anisotropy.map(|a| ("anisotropy", a, 3)),
            coat.map(|c| ("coat", c, 2)),
            sheen.map(|s| ("sheen", s, 4)),
        ];
        let given = [
            ("normal", normal, 3),
            ("diffuse", diffuse, 3),
            ("specular", specular, 3),
            ("roughness", roughness, 1),
        ];
        let given = given.into_iter().chain(optional.into_iter().flatten());
        let ([height, width], read) = same_size(given)?;
        let normals = read[0].as_chunks::<3>().0;
        if normals.iter().any(|n| n[2] <= 0.0) {
            return Err(argument("normal", "normals that point up are expected: z > 0"));
        }
        let slope = |n: &[f32; 3], axis: usize| (n[axis] / n[2]).clamp(-MAX_SLOPE, MAX_SLOPE);
        let mut planes = Vec::with_capacity(9 * width * height);
        planes.extend(normals.iter().map(|n| slope(n, 0)));
        planes.extend(normals.iter().map(|n| slope(n, 1)));
        for colours in &read[1..3] {
            for c in 0..3 {
                planes.extend(colours.iter().skip(c).step_by(3));
            }
        }
        let mut read = read.into_iter().skip(3);
        let roughness = read.next().expect("four arrays");
        let anisotropy = anisotropy.and_then(|_| read.next());
        let coat = coat.and_then(|_| read.next());
        let sheen = sheen.and_then(|_| read.next());
        planes.extend(roughness);
        let sample_mm = lengths(sample_mm)?;
        let maps = detached(py, || {
            let mut maps = Svbrdf::from_planes(width, height, planes)?;
            gltf::add_lobes(
                &mut maps,
                anisotropy.as_ref().map(|values| values.as_chunks::<3>().0.iter().copied()),
                coat.as_ref().map(|values| values.as_chunks::<2>().0.iter().copied()),
                sheen.as_ref().map(|values| values.as_chunks::<4>().0.iter().copied()),
            )?;
            Ok(maps)
        })?;
        Ok(Self::of(py, Arc::new(maps), None, sample_mm))
    }

    /// Reads a folder with ``maps.exr`` or images ``normal``, ``diffuse``, ``specular``, ``roughness``.
    ///
    /// ``sample_mm`` is the size of the sample; by default that of the files.
    #[staticmethod]
    #[pyo3(signature = (folder, *, sample_mm = None))]
    fn load(py: Python<'_>, folder: PathBuf, sample_mm: Option<(f32, f32)>) -> PyResult<Self> {
        let maps = detached(py, || export::read_maps(&folder))?;
        let sample_mm = match sample_mm {
            Some(given) => lengths(given)?,
            None => detached(py, || export::read_sample_mm(&folder))?.ok_or_else(|| {
                argument("sample_mm", format!("{} does not state it", folder.display()))
            })?,
        };
        Ok(Self::of(py, Arc::new(maps), None, sample_mm))
    }

    /// Width and height of the sample, mm.
    #[getter]
    fn sample_mm(&self) -> (f32, f32) {
        self.sample_mm.into()
    }

    /// Rows and columns.
    #[getter]
    fn size(&self) -> (usize, usize) {
        (self.maps.height(), self.maps.width())
    }

    /// The report of each photograph of a fit; empty for other maps.
    #[getter]
    fn photos<'py>(&self, py: Python<'py>) -> Bound<'py, PyTuple> {
        self.photos.bind(py).clone()
    }

    /// Unit normals, (height, width, 3): X right, Y up, Z out of the sample.
    #[getter]
    fn normal<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f32>> {
        let width = self.maps.width();
        self.texels(py, |i| self.maps.normal(i % width, i / width))
    }

    /// Diffuse albedo, (height, width, 3), linear RGB.
    #[getter]
    fn diffuse<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f32>> {
        self.colours(py, self.maps.diffuse())
    }

    /// Specular albedo at normal incidence (F0), (height, width, 3), linear RGB.
    #[getter]
    fn specular<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f32>> {
        self.colours(py, self.maps.specular())
    }

    /// Roughness, (height, width): GGX with alpha = roughness squared. Where the material is anisotropic, of the smaller alpha.
    #[getter]
    fn roughness<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f32>> {
        let texels = 0..self.maps.texels();
        let of = |texel| gltf::roughness(&self.maps, texel);
        self.plane(py, &texels.map(of).collect::<Vec<_>>())
    }

    /// Anisotropy, (height, width, 3), as glTF's ``KHR_materials_anisotropy``: cosine and sine of the direction of the larger
    /// alpha, counter-clockwise from X, and strength; that alpha is alpha + (1 - alpha) * strength squared, with alpha =
    /// roughness squared across it. ``None`` where the material is isotropic.
    ///
    /// >>> import numpy as np
    /// >>> gray = np.full((2, 2, 3), 0.5)
    /// >>> flat = np.zeros((2, 2, 3)); flat[..., 2] = 1
    /// >>> brushed = np.zeros((2, 2, 3)); brushed[..., 1] = 1; brushed[..., 2] = 0.5
    /// >>> maps = Maps.from_arrays(flat, gray, gray, np.full((2, 2), 0.25), sample_mm=(9, 9), anisotropy=brushed)
    /// >>> bool(np.allclose(maps.anisotropy, brushed, atol=1e-6)), maps.coat is None
    /// (True, True)
    #[getter]
    fn anisotropy<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray3<f32>>> {
        let mean = Shown::of(&self.maps).anisotropy?;
        Some(self.texels(py, |i| gltf::anisotropy(&self.maps, mean, i)))
    }

    /// Weight and roughness of a coat, (height, width, 2), as glTF's ``KHR_materials_clearcoat``: a dielectric with F0 0.04 above
    /// everything else. ``None`` where the material has none.
    #[getter]
    fn coat<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray3<f32>>> {
        let shown = Shown::of(&self.maps).coat;
        shown.then(|| self.texels(py, |i| gltf::coat(&self.maps, i)))
    }

    /// Colour (linear RGB) and roughness of sheen, (height, width, 4), as glTF's ``KHR_materials_sheen``. ``None`` where the
    /// material has none.
    #[getter]
    fn sheen<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray3<f32>>> {
        let shown = Shown::of(&self.maps).sheen;
        shown.then(|| self.texels(py, |i| gltf::sheen(&self.maps, i)))
    }

    /// Standard deviations, each (height, width), under ``normal`` (of each slope), ``diffuse``, ``specular`` (of each
    /// colour) and ``roughness``; ``None`` where they are not known. With the lobes also ``anisotropy``, (height, width, 2), of
    /// ln(larger alpha / smaller alpha) times the cosine and times the sine of twice the direction's angle; ``coat``, (height,
    /// width, 2), and ``sheen``, (height, width, 4), of their values.
    #[getter]
    fn deviations<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(uncertainty) = &self.uncertainty else { return Ok(None) };
        let deviations = PyDict::new(py);
        for (name, plane) in [
            ("normal", uncertainty.normal()),
            ("diffuse", uncertainty.diffuse()),
            ("specular", uncertainty.specular()),
            ("roughness", uncertainty.roughness()),
        ] {
            deviations.set_item(name, self.plane(py, plane))?;
        }
        let Shown { anisotropy, coat, sheen } = Shown::of(&self.maps);
        let of = |lobe: usize, i: usize| uncertainty.lobe(lobe).map_or(0.0, |plane| plane[i]);
        if anisotropy.is_some() {
            let planes = [lobe::ANISOTROPY_X, lobe::ANISOTROPY_Y];
            deviations
                .set_item("anisotropy", self.texels(py, |i| planes.map(|lobe| of(lobe, i))))?;
        }
        if coat {
            let planes = [lobe::COAT, lobe::COAT_ROUGHNESS];
            deviations.set_item("coat", self.texels(py, |i| planes.map(|lobe| of(lobe, i))))?;
        }
        if sheen {
            let planes = [0, 1, 2, 3].map(|c| lobe::SHEEN + c);
            deviations.set_item("sheen", self.texels(py, |i| planes.map(|lobe| of(lobe, i))))?;
        }
        Ok(Some(deviations))
    }

    /// Writes ``normal.png``, ``diffuse.png``, ``specular.png``, ``roughness.png`` (16 bits) and ``maps.exr`` into a folder,
    /// which is made if missing: all files or none.
    fn save(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        let uncertainty = self.uncertainty.as_deref();
        let options = export::MapsOptions { sample_mm: Some(self.sample_mm), uncertainty };
        detached(py, || export::write_maps(folder, &self.maps, &options))
    }

    /// Writes an image of the material under four lights.
    fn save_preview(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        detached(py, || export::write_preview(path, &self.maps, self.sample_mm))
    }

    /// Writes files for other programs into a folder, which is made if missing: all or none. Returns their names.
    ///
    /// ``formats``: ``glb``, ``usdz``, ``materialx``, ``unreal``, ``unity-hdrp``, ``unity-urp``, ``blender``. ``tile`` makes the maps
    /// seamless, ``metallic`` stores base colour and metalness, ``texture`` is ``png8``, ``png16`` or ``jpeg``, ``max_size`` the
    /// largest longer side of textures.
    #[pyo3(signature = (folder, formats, *, tile = false, metallic = false, texture = "png8", max_size = None))]
    fn export(
        &self,
        py: Python<'_>,
        folder: PathBuf,
        formats: Vec<String>,
        tile: bool,
        metallic: bool,
        texture: &str,
        max_size: Option<usize>,
    ) -> PyResult<Vec<String>> {
        let package = self.packed(py, formats, tile, metallic, texture, max_size)?;
        detached(py, || package.write(folder))?;
        Ok(package.files.into_iter().map(|(name, _)| name).collect())
    }

    /// As ``export``, in memory: names and bytes of the files.
    #[pyo3(signature = (formats, *, tile = false, metallic = false, texture = "png8", max_size = None))]
    fn package<'py>(
        &self,
        py: Python<'py>,
        formats: Vec<String>,
        tile: bool,
        metallic: bool,
        texture: &str,
        max_size: Option<usize>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let package = self.packed(py, formats, tile, metallic, texture, max_size)?;
        let files = PyDict::new(py);
        for (name, bytes) in package.files {
            files.set_item(name, pyo3::types::PyBytes::new(py, &bytes))?;
        }
        Ok(files)
    }

    /// Linear radiance of every texel, (height, width, 3), seen from ``camera_mm`` under one light at ``light_mm`` that lights
    /// all texels alike: a white surface facing it comes out at its albedo.
    ///
    /// >>> import numpy as np
    /// >>> flat = np.zeros((4, 4, 3)); flat[..., 2] = 1
    /// >>> maps = Maps.from_arrays(flat, flat * 0 + 0.5, flat * 0, np.ones((4, 4)), sample_mm=(1, 1))
    /// >>> round(float(maps.render(camera_mm=(0, 0, 500), light_mm=(0, 0, 500)).mean()), 3)
    /// 0.5
    #[pyo3(signature = (*, camera_mm, light_mm))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        camera_mm: (f32, f32, f32),
        light_mm: (f32, f32, f32),
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let above = |name: &str, (x, y, z): (f32, f32, f32)| {
            let fine = [x, y, z].iter().all(|v| v.is_finite()) && z > 0.0;
            let expected = "three finite numbers with z > 0 are expected";
            if fine { Ok([x, y, z]) } else { Err(argument(name, expected)) }
        };
        let view = View {
            sample_mm: self.sample_mm,
            camera_mm: above("camera_mm", camera_mm)?,
            light_mm: above("light_mm", light_mm)?,
            ..View::default()
        };
        let [height, width] = self.shape();
        let texels = width * height;
        let mut planes = vec![0.0; 3 * texels];
        py.detach(|| render::render(&self.maps, &view, &mut planes));
        let values = (0..texels).flat_map(|i| [0, 1, 2].map(|c| planes[c * texels + i])).collect();
        Ok(array(py, Ix3(height, width, 3), values))
    }

    /// The same maps with the reports of photographs.
    fn _with_photos(&self, photos: Py<PyTuple>) -> Self {
        let (maps, uncertainty) = (self.maps.clone(), self.uncertainty.clone());
        Self { maps, uncertainty, sample_mm: self.sample_mm, photos }
    }

    fn __repr__(&self) -> String {
        let ([height, width], [x, y]) = (self.shape(), self.sample_mm);
        format!("<Maps of {width} x {height} texels, {x} x {y} mm>")
    }
}

/// Maps of the same size, with their name and number of channels: height and width, and values in their range.
fn same_size<'a, 'py: 'a>(
    given: impl Iterator<Item = (&'static str, &'a Bound<'py, PyAny>, usize)>,
) -> PyResult<([usize; 2], Vec<Vec<f32>>)> {
    let mut first = None;
    let mut read = Vec::new();
    for (name, values, channels) in given {
        let (shape, values) = floats(name, values)?;
        let found = size(name, &shape, channels)?;
        let [height, width] = *first.get_or_insert(found);
        if found != [height, width] {
            let message = format!("{found:?} texels given; {height} x {width} expected");
            return Err(argument(name, message));
        }
        // Directions have signs, strengths of anisotropy have none.
        let signed = |i: usize| name == "normal" || name == "anisotropy" && i % 3 < 2;
        for (i, value) in values.iter().enumerate() {
            let allowed = if signed(i) { -1.001..=1.001 } else { 0.0..=1.0 };
            if !allowed.contains(value) {
                let (low, high) = (allowed.start().round(), allowed.end().round());
                return Err(argument(name, format!("{value} given; {low} to {high} expected")));
            }
        }
        read.push(values);
    }
    Ok((first.expect("four arrays"), read))
}

/// Width and height of a sample.
pub fn lengths((width, height): (f32, f32)) -> PyResult<[f32; 2]> {
    let given = [width, height];
    if given.iter().all(|v| v.is_finite() && *v > 0.0) {
        Ok(given)
    } else {
        Err(argument("sample_mm", format!("{given:?} given; two positive lengths in mm expected")))
    }
}
