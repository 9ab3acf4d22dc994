//! Runs the program, and creates small scenes for it.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;

use glam::{DVec3, Vec3};
use gonio::lighting::studio_light;
use gonio::picture::{Picture, Plane};
use gonio::reflectance::{BivariateTable, MerlTable};
use gonio::render::{LightTree, SphereSettings, render_sphere};
use gonio_io::npy;
use gonio_io::picture::encode_hdr;

/// Side of the pictures of the ball.
pub(crate) const SIZE: usize = 48;

/// Environment of runs that write pictures and pages. Other runs write neither, for speed.
pub(crate) const WITH_PAGES: [(&str, &str); 2] = [("GONIO_NO_REPORT", "false"), ("GONIO_NO_PICTURES", "false")];

/// Exit code and output of a run of the program.
#[derive(Debug)]
pub(crate) struct Run {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Run {
    fn of(out: &Output) -> Self {
        let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
        Self { code: out.status.code(), stdout: text(&out.stdout), stderr: text(&out.stderr) }
    }

    #[track_caller]
    pub(crate) fn succeeds(self) -> Self {
        assert_eq!(self.code, Some(0), "{self:?}");
        self
    }

    /// Asserts exit code 2 and one line on standard error that contains each of `parts`.
    #[track_caller]
    pub(crate) fn fails(self, parts: &[&str]) -> Self {
        assert_eq!(self.code, Some(2), "{self:?}");
        assert_eq!(self.stdout, "");
        let lines: Vec<&str> = self.stderr.lines().collect();
        assert!(lines.len() == 1 && lines[0].starts_with("error: "), "{self:?}");
        assert!(parts.iter().all(|s| lines[0].contains(s)), "{self:?} does not contain all of {parts:?}");
        self
    }
}

/// A folder to run the program in; all names are relative to it.
pub(crate) struct Bench(tempfile::TempDir);

impl Bench {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap())
    }

    /// Creates a bench with the ball as `ball.exr` with alpha, and its normals as `normals.npy`.
    pub(crate) fn with_ball() -> Self {
        let bench = Self::new();
        bench.write("ball.exr", &exr(&ball()));
        bench.write("normals.npy", &encode_normals(&normals(SIZE)));
        bench
    }

    /// Creates a bench with a light as `light.hdr` and a material as `in.binary`.
    pub(crate) fn with_light_and_material() -> Self {
        let bench = Self::new();
        bench.write("light.hdr", &encode_hdr(studio_light(16).radiance()));
        gonio_io::merl::write(bench.path("in.binary"), &merl(&material(0.1, 0.3))).unwrap();
        bench
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, bytes: &[u8]) {
        fs::write(self.path(name), bytes).unwrap();
    }

    /// Writes [`ANSWER`] into a folder.
    pub(crate) fn write_answer(&self, folder: &str) {
        fs::create_dir_all(self.path(folder)).unwrap();
        for (name, bytes) in &ANSWER.0 {
            self.write(&format!("{folder}/{name}"), bytes);
        }
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap()
    }

    pub(crate) fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_slice(&self.read(name)).unwrap()
    }

    /// Runs `gonio` with the words of `line` as arguments.
    pub(crate) fn run(&self, line: &str) -> Run {
        self.run_with(line, &[])
    }

    /// Runs the program as [`Self::run`] does, but with pictures, and with a thread for each core.
    pub(crate) fn run_with_pictures(&self, line: &str) -> Run {
        let mut command = self.command(line);
        Run::of(&command.env_remove("GONIO_NO_PICTURES").env_remove("RAYON_NUM_THREADS").output().unwrap())
    }

    /// Runs the program with environment variables.
    pub(crate) fn run_with(&self, line: &str, environment: &[(&str, &str)]) -> Run {
        Run::of(&self.command(line).envs(environment.iter().copied()).output().unwrap())
    }

    /// Runs the program with a file as standard input.
    pub(crate) fn run_reading(&self, line: &str, file: &str) -> Run {
        Run::of(&self.command(line).stdin(fs::File::open(self.path(file)).unwrap()).output().unwrap())
    }

    /// Creates the command with the words of `line` as arguments.
    pub(crate) fn command(&self, line: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gonio"));
        command
            .args(line.split_whitespace())
            .current_dir(self.0.path())
            // The tests run in parallel. One thread for each process is faster than several.
            .env("RAYON_NUM_THREADS", "1")
            // Pictures and report take longer than everything else; the tests of both enable them,
            // and tools/nightly.sh enables the pictures of all tests.
            .env("GONIO_NO_REPORT", "true")
            .env("GONIO_NO_PICTURES", std::env::var_os("GONIO_NO_PICTURES").unwrap_or("true".into()));
        command
    }

    /// Runs `gonio`, and asserts that it [fails](Run::fails) and does not change the folder.
    #[track_caller]
    pub(crate) fn refuses(&self, line: &str, parts: &[&str]) {
        let before = self.tree();
        self.run(line).fails(parts);
        assert_eq!(self.tree(), before, "{line}");
    }

    /// Lists everything below the folder, including hidden files, with the lengths of files.
    pub(crate) fn tree(&self) -> BTreeMap<PathBuf, u64> {
        fn walk(dir: &Path, into: &mut BTreeMap<PathBuf, u64>) {
            for entry in fs::read_dir(dir).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    walk(&path, into);
                }
                let length = if path.is_file() { path.metadata().unwrap().len() } else { 0 };
                into.insert(path, length);
            }
        }
        let mut tree = BTreeMap::new();
        walk(self.0.path(), &mut tree);
        tree
    }

    /// Lists the names in a folder, sorted.
    pub(crate) fn names(&self, dir: &str) -> Vec<String> {
        let name = |e: std::io::Result<fs::DirEntry>| e.unwrap().file_name().into_string().unwrap();
        let mut names: Vec<String> = fs::read_dir(self.path(dir)).unwrap().map(name).collect();
        names.sort();
        names
    }

    /// Reads the files of a folder.
    pub(crate) fn files(&self, dir: &str) -> Files {
        Files(self.names(dir).into_iter().map(|name| (name.clone(), self.read(&format!("{dir}/{name}")))).collect())
    }

    /// Reads the luminance of the BRDF in a folder.
    pub(crate) fn luminance(&self, dir: &str) -> BivariateTable {
        BivariateTable::luminance(&self.channels(dir))
    }

    /// Reads the channels of the BRDF in a folder.
    pub(crate) fn channels(&self, dir: &str) -> [BivariateTable; 3] {
        gonio_io::result_brdf::read(self.path(dir).join("brdf.npz")).unwrap()
    }
}

/// Files by name.
#[derive(Debug, PartialEq)]
pub(crate) struct Files(pub(crate) BTreeMap<String, Vec<u8>>);

impl Files {
    pub(crate) fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_slice(&self.0[name]).unwrap()
    }
}

/// Output of `gonio infer` for the ball, which all tests share.
pub(crate) static ANSWER: LazyLock<Files> = LazyLock::new(|| {
    let bench = Bench::with_ball();
    bench.run_with_pictures("infer ball.exr -o out --grid 8").succeeds();
    bench.files("out")
});

/// Returns all values of an attribute in a page.
pub(crate) fn attributes<'a>(page: &'a str, name: &str) -> Vec<&'a str> {
    let start = format!(" {name}=\"");
    page.split(&start).skip(1).map(|rest| rest.split('"').next().unwrap()).collect()
}

/// Whether a text contains control characters other than line feeds.
pub(crate) fn has_controls(text: &str) -> bool {
    text.chars().any(|c| (c.is_control() && c != '\n') || c == '\u{202e}')
}

/// Returns a diffuse material with a highlight; `width` is in radians.
pub(crate) fn material(diffuse: f64, width: f64) -> BivariateTable {
    BivariateTable::from_fn(|h, d| diffuse + 0.8 * (1.0 + d) * (-(h / width).powi(2)).exp())
}

pub(crate) fn merl(table: &BivariateTable) -> MerlTable {
    MerlTable::from_bivariate([table, table, table])
}

/// Returns a photograph of a ball with alpha and noise of two per cent. Without noise, the
/// inference would take longer.
pub(crate) fn ball() -> Picture {
    static BALL: LazyLock<Picture> = LazyLock::new(|| ball_of(SIZE));
    BALL.clone()
}

/// Returns the photograph of the ball with another size.
pub(crate) fn ball_of(size: usize) -> Picture {
    let settings = SphereSettings { size, ..SphereSettings::default() };
    let light = LightTree::of_map(&studio_light(32));
    let mut picture = render_sphere(&merl(&material(0.1, 0.3)), &light, &settings, &|_| ());
    for (i, colour) in picture.rgb.as_mut_slice().iter_mut().enumerate() {
        *colour *= 1.0 + 0.02 * (1e4 * (i as f32 * 0.73).sin()).sin();
    }
    picture
}

pub(crate) fn exr(picture: &Picture) -> Vec<u8> {
    gonio_io::picture::encode_exr(&picture.rgb, picture.alpha.as_ref())
}

pub(crate) fn grey(value: f32, width: usize, height: usize) -> Vec<u8> {
    gonio_io::picture::encode_exr(&Plane::from_fn(width, height, |_, _| Vec3::splat(value)), None)
}

/// Returns the normals of a ball that fills `size` x `size` pixels except for the renderer's
/// margin.
pub(crate) fn normals(size: usize) -> Plane<Vec3> {
    let (centre, radius) = (0.5 * size as f64, SphereSettings { size, ..SphereSettings::default() }.radius());
    Plane::from_fn(size, size, |x, y| {
        let (a, b) = ((x as f64 + 0.5 - centre) / radius, (centre - y as f64 - 0.5) / radius);
        let rest = 1.0 - a * a - b * b;
        if rest > 0.0 { DVec3::new(a, b, rest.sqrt()).as_vec3() } else { Vec3::ZERO }
    })
}

pub(crate) fn encode_normals(normals: &Plane<Vec3>) -> Vec<u8> {
    let values = normals.as_slice().iter().flat_map(|n| n.to_array()).collect();
    npy::encode(&npy::Array { shape: vec![normals.height(), normals.width(), 3], values })
}

/// Encodes a mask that is white on the ball.
pub(crate) fn mask(size: usize) -> Vec<u8> {
    let white = |n: &Vec3| if *n == Vec3::ZERO { Vec3::ZERO } else { Vec3::ONE };
    gonio_io::picture::encode_png(&normals(size).map(white))
}
