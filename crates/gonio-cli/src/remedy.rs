//! Remedies in the words of the program: its options.

use gonio::remedy::Remedy;
use gonio::scene::{Circle, Correction};
use gonio_app::{Problem, Warning};

/// Words a remedy as an option.
pub(crate) fn words(remedy: &Remedy) -> Option<String> {
    let words = match remedy {
        Remedy::Outline => "give the outline of the ball with --circle X,Y,RADIUS",
        Remedy::Ellipsoid => "say --shape ellipsoid if it is one",
        Remedy::DepthAxis => "give it with --depth-axis PIXELS if you know it",
        Remedy::Camera => "give the camera with --camera FILE.json",
        Remedy::Pose => "check --pose FILE.json",
        Remedy::Mask => "give a mask with --mask FILE",
        Remedy::Mesh => "give the shape with --mesh FILE",
        Remedy::Normals => "give the shape with --normals FILE",
        Remedy::NormalAxes(corrections) => return axes(corrections),
        Remedy::OneOf(circles) => return one_of(circles),
        Remedy::TrustNormals => "take them as they are with --trust-normals",
        Remedy::KeepColours => "use them with --keep-colors",
        Remedy::Linear => "pass --linear if its values are linear radiance",
        Remedy::Layer => "take another with --layer NAME",
        Remedy::DepthRange => "give the range with --depth-range NEAR,FAR",
        Remedy::ChartCorners => {
            "give the centres of its corner patches (dark skin, bluish green, black, white) with --color-checker X,Y,X,Y,X,Y,X,Y"
        }
        Remedy::ClipLevel => "give the level with --clip VALUE if they are not clipped",
        Remedy::ReferenceColourOnly => "use its colour alone with --reference-color-only",
        Remedy::Times => "--times takes them",
        Remedy::Separately => {
            "give each photograph by itself, or infer from all of them with `gonio batch IMAGE... -o DIR`"
        }
        Remedy::Turn => "give the angle with --second-yaw DEGREES",
        Remedy::SecondOutline => "give the outline of the ball with --second-circle X,Y,RADIUS",
        Remedy::SecondMask => "give a mask with --second-mask FILE",
        Remedy::LearnPosterior => {
            "learn one with `gonio train posterior` and join it with `gonio train model --posterior`, or choose another --method"
        }
        _ => return None,
    };
    Some(words.to_owned())
}

/// Lists the options of each correction, the most probable first.
fn axes(corrections: &[Correction]) -> Option<String> {
    let options = |correction: &Correction| {
        let order = correction.reordered().map(|order| format!("--normals-order {order}"));
        let flips = correction.flips().into_iter().map(|axis| format!("--normals-flip-{axis}"));
        order.into_iter().chain(flips).collect::<Vec<_>>().join(" ")
    };
    let (first, others) = corrections.split_first()?;
    let others: Vec<String> = others.iter().map(options).collect();
    let others = if others.is_empty() { String::new() } else { format!(" (or {})", others.join(", or ")) };
    Some(format!("give {}{others}", options(first)))
}

/// Lists the option of each circle, numbered as in the picture of `gonio check`.
fn one_of(circles: &[Circle]) -> Option<String> {
    let option = |circle: &Circle| format!("--circle {:.1},{:.1},{:.1}", circle.x, circle.y, circle.radius);
    let numbered = |(at, circle): (usize, &Circle)| format!("({}) {}", at + 1, option(circle));
    match circles {
        [] => None,
        [one] => Some(format!("give it with {} if that is the ball", option(one))),
        several => {
            let listed: Vec<String> = several.iter().enumerate().map(numbered).collect();
            Some(format!("give the right one, numbered in the picture that gonio check makes: {}", listed.join(", ")))
        }
    }
}

/// Words warnings for the user of the program.
pub(crate) fn worded(warnings: &[Warning]) -> Vec<String> {
    warnings.iter().map(|warning| warning.worded(&words)).collect()
}

/// Words a problem for the user of the program.
pub(crate) fn plain(problem: Problem) -> anyhow::Error {
    anyhow::Error::msg(problem.worded(&words))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corrections_are_options() {
        let flip = Correction { flip_y: true, ..Correction::default() };
        let swap = Correction { order: [1, 0, 2], ..flip };
        let worded = words(&Remedy::NormalAxes(vec![flip, swap])).unwrap();
        assert_eq!(worded, "give --normals-flip-y (or --normals-order yxz --normals-flip-y)");
        assert_eq!(words(&Remedy::NormalAxes(Vec::new())), None);
    }

    #[test]
    fn circles_are_options_too() {
        let circles = [30.04, 50.0].map(|x| Circle { x, y: 40.0, radius: 20.26 }).to_vec();
        assert!(
            words(&Remedy::OneOf(circles.clone()))
                .unwrap()
                .ends_with(": (1) --circle 30.0,40.0,20.3, (2) --circle 50.0,40.0,20.3")
        );
        assert_eq!(
            words(&Remedy::OneOf(circles[..1].to_vec())).unwrap(),
            "give it with --circle 30.0,40.0,20.3 if that is the ball"
        );
        assert_eq!(words(&Remedy::OneOf(Vec::new())), None);
    }
}
