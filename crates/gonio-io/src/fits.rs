//! Published fits of parametric models to the MERL materials (Ngan et al. 2005), one text file per
//! model.
//!
//! A line is
//! `NAME = Aggregate(Lambertian(albedo = [r, g, b]), NganMODEL(albedo = [r, g, b], ...))`; lines
//! that start with `#` and blank lines are skipped.

use std::path::Path;

use crate::{Error, guard};

/// Parameters of one material. `diffuse` and `specular` are the RGB weights of the two lobes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParametricFit {
    /// Cook and Torrance: Beckmann distribution, Schlick's Fresnel term, V-groove shadowing.
    CookTorrance {
        /// Albedo of the Lambertian lobe.
        diffuse: [f64; 3],
        /// Weight of the specular lobe.
        specular: [f64; 3],
        /// Reflectance at normal incidence, called `eta` in the file.
        f0: f64,
        /// RMS slope of the microfacets.
        roughness: f64,
    },
    /// Ward's isotropic model.
    Ward {
        /// Albedo of the Lambertian lobe.
        diffuse: [f64; 3],
        /// Weight of the specular lobe.
        specular: [f64; 3],
        /// RMS slope of the microfacets.
        roughness: f64,
    },
    /// Lafortune's model with one isotropic lobe.
    Lafortune {
        /// Albedo of the Lambertian lobe.
        diffuse: [f64; 3],
        /// Weight of the specular lobe.
        specular: [f64; 3],
        /// Coefficient of the tangential components, about -0.577.
        cxy: f64,
        /// Coefficient of the normal component, about 0.577.
        cz: f64,
        /// Exponent of the lobe.
        exponent: f64,
    },
}

/// Reads all materials of a `.fit` file, in file order.
///
/// # Errors
/// If the file cannot be read, a line does not parse (the message has its number), a material
/// occurs twice, or the file has no materials.
pub fn read_fits(path: impl AsRef<Path>) -> Result<Vec<(String, ParametricFit)>, Error> {
    let path = path.as_ref();
    decode(path, &guard::read_whole(path, 1 << 24)?)
}

/// Parses the content of a `.fit` file; `path` is only used in error messages.
///
/// # Errors
/// Like [`read_fits`].
pub fn decode(path: &Path, bytes: &[u8]) -> Result<Vec<(String, ParametricFit)>, Error> {
    let text = std::str::from_utf8(bytes).map_err(|_| Error::damaged(path, "is not UTF-8 text"))?;
    let mut fits: Vec<(String, ParametricFit)> = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let failed = |what: String| {
            Error::invalid(path, format!("line {number}: {what}"), "correct the line or download the file again")
        };
        let (name, fit) = Parser { rest: line }.line().map_err(failed)?;
        if fits.iter().any(|f| f.0 == name) {
            return Err(failed(format!("{name} occurs twice")));
        }
        fits.push((name, fit));
    }
    if fits.is_empty() {
        return Err(Error::invalid(path, "contains no material", "use a .fit file of Ngan et al. 2005"));
    }
    Ok(fits)
}

/// Unparsed rest of a line. White space between tokens does not matter.
struct Parser<'a> {
    rest: &'a str,
}

impl<'a> Parser<'a> {
    fn line(mut self) -> Result<(String, ParametricFit), String> {
        let name = self.word()?;
        self.all(&["=", "Aggregate", "(", "Lambertian", "("])?;
        let diffuse = self.colour()?;
        self.all(&[")", ","])?;
        let model = self.word()?;
        self.all(&["("])?;
        let specular = self.colour()?;
        let fit = match model.as_str() {
            "NganCookTorrance" => {
                let f0 = self.next_field("eta")?;
                ParametricFit::CookTorrance { diffuse, specular, f0, roughness: self.roughness()? }
            }
            "NganWard" => ParametricFit::Ward { diffuse, specular, roughness: self.roughness()? },
            "NganLafortune" => {
                let (cxy, cz) = (self.next_field("Cxy")?, self.next_field("Cz")?);
                ParametricFit::Lafortune { diffuse, specular, cxy, cz, exponent: self.next_field("sharpness")? }
            }
            _ => return Err(format!("unknown model {model}")),
        };
        self.all(&[")", ")"])?;
        if self.rest.trim().is_empty() {
            Ok((name, fit))
        } else {
            Err(format!("unexpected text after the end: {}", self.near()))
        }
    }

    /// Parses `, NAME = NUMBER`.
    fn next_field(&mut self, name: &str) -> Result<f64, String> {
        self.all(&[",", name, "="])?;
        self.number()
    }

    fn roughness(&mut self) -> Result<f64, String> {
        let value = self.next_field("roughness")?;
        if value > 0.0 { Ok(value) } else { Err(format!("the roughness {value} is not positive")) }
    }

    /// Parses `albedo = [NUMBER, NUMBER, NUMBER]`.
    fn colour(&mut self) -> Result<[f64; 3], String> {
        self.all(&["albedo", "=", "["])?;
        let r = self.number()?;
        self.all(&[","])?;
        let g = self.number()?;
        self.all(&[","])?;
        let b = self.number()?;
        self.all(&["]"])?;
        Ok([r, g, b])
    }

    fn all(&mut self, tokens: &[&str]) -> Result<(), String> {
        for token in tokens {
            let rest = self.rest.trim_start().strip_prefix(token);
            self.rest = rest.ok_or_else(|| format!("expected `{token}`, found {}", self.near()))?;
        }
        Ok(())
    }

    fn number(&mut self) -> Result<f64, String> {
        let text = self.take(|c| c.is_ascii_alphanumeric() || "+-.".contains(c));
        let value = text.parse::<f64>().ok().filter(|v| v.is_finite());
        value.ok_or_else(|| format!("expected a number, found `{text}` before {}", self.near()))
    }

    fn word(&mut self) -> Result<String, String> {
        let word = self.take(|c| c.is_alphanumeric() || "-_.".contains(c)).to_owned();
        if word.is_empty() { Err(format!("expected a name, found {}", self.near())) } else { Ok(word) }
    }

    fn take(&mut self, belongs: impl Fn(char) -> bool) -> &'a str {
        let text = self.rest.trim_start();
        let end = text.find(|c| !belongs(c)).unwrap_or(text.len());
        self.rest = &text[end..];
        &text[..end]
    }

    fn near(&self) -> String {
        match self.rest.trim() {
            "" => "the end of the line".to_owned(),
            rest => format!("`{}`", rest.chars().take(20).collect::<String>()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "# comment\n\na-1 = Aggregate(Lambertian(albedo = [0.1, 0.0, 1e-3]), ";

    fn read(tail: &str) -> Result<Vec<(String, ParametricFit)>, Error> {
        decode(Path::new("x.fit"), format!("{HEAD}{tail}").as_bytes())
    }

    #[test]
    fn the_three_models_parse() {
        let (diffuse, specular) = ([0.1, 0.0, 1e-3], [1.0, 2.0, 3.0]);
        for (tail, fit) in [
            (
                "NganCookTorrance(albedo = [1, 2, 3], eta = 0.117, roughness = 0.0137))",
                ParametricFit::CookTorrance { diffuse, specular, f0: 0.117, roughness: 0.0137 },
            ),
            ("NganWard(albedo=[1,2,3],roughness=0.5))", ParametricFit::Ward { diffuse, specular, roughness: 0.5 }),
            (
                "NganLafortune(albedo = [1, 2, 3], Cxy = -0.577, Cz = 0.577, sharpness = 4060.0))\n",
                ParametricFit::Lafortune { diffuse, specular, cxy: -0.577, cz: 0.577, exponent: 4060.0 },
            ),
        ] {
            assert_eq!(read(tail).unwrap(), [("a-1".to_owned(), fit)]);
        }
    }

    #[test]
    fn errors_name_the_line() {
        for (tail, message) in [
            ("NganWard(albedo = [1, 2, 3], roughness = 0.5)", "line 3: expected `)`, found the end of the line"),
            ("NganWard(albedo = [1, 2], roughness = 0.5))", "line 3: expected `,`, found `], roughness = 0.5))`"),
            ("NganWard(albedo = [1, 2, nan], roughness = 0.5))", "expected a number, found `nan`"),
            ("NganWard(albedo = [1, 2, 3], roughness = 0))", "not positive"),
            ("NganPhong(albedo = [1, 2, 3]))", "unknown model NganPhong"),
            ("NganWard(albedo = [1, 2, 3], roughness = 0.5)) x", "unexpected text after the end"),
        ] {
            let error = read(tail).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
        assert!(decode(Path::new("x"), b"# nothing\n").is_err());
        let line = HEAD.lines().last().unwrap().to_owned() + "NganWard(albedo = [1, 2, 3], roughness = 0.5))\n";
        let twice = decode(Path::new("x"), line.repeat(2).as_bytes()).unwrap_err().to_string();
        assert!(twice.contains("line 2: a-1 occurs twice"), "{twice}");
    }
}
