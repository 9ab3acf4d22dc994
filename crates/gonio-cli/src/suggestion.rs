//! Words suggestions as options of the program.

use gonio::scene::{Circle, Correction};
use gonio::suggestion::Suggestion;
use gonio_app::{AppError, Warning};

/// Words a suggestion as an option.
pub(crate) fn words(suggestion: &Suggestion) -> Option<String> {
    let words = match suggestion {
        Suggestion::Inflate => "use --shape outline if the object is smooth",
        Suggestion::MirrorBall => "check --mirror-ball X,Y,RADIUS",
        Suggestion::Outline => "specify the outline of the ball with --circle X,Y,RADIUS",
        Suggestion::Ellipsoid => "use --shape ellipsoid if the object is an ellipsoid",
        Suggestion::DepthAxis => "specify it with --depth-axis PIXELS if it is known",
        Suggestion::Camera => "specify the camera with --camera FILE.json",
        Suggestion::Pose => "check --pose FILE.json",
        Suggestion::Mask => "specify a mask with --mask FILE",
        Suggestion::Mesh => "specify the shape with --mesh FILE",
        Suggestion::Normals => "specify the shape with --normals FILE",
        Suggestion::NormalAxes(corrections) => return axes(corrections),
        Suggestion::OneOf(circles) => return one_of(circles),
        Suggestion::TrustNormals => "skip this check with --trust-normals",
        Suggestion::OneMaterial => "to use all pixels unchanged, specify --one-material",
        Suggestion::AlignLight => "search for the rotation of the environment map with --align-light",
        Suggestion::Force => "use --force to estimate anyway",
        Suggestion::Linear => "use --linear if the values are linear radiance",
        Suggestion::Layer => "select another layer with --layer NAME",
        Suggestion::DepthRange => "specify the range with --depth-range NEAR,FAR",
        Suggestion::ChartCorners => {
            "specify the centres of its corner patches (dark skin, bluish green, black, white) with --color-checker X,Y,X,Y,X,Y,X,Y"
        }
        Suggestion::ClipLevel => "if they are not clipped, specify the clip level with --clip VALUE",
        Suggestion::ReferenceColourOnly => "use only its colour with --reference-color-only",
        Suggestion::Times => "specify them with --times 1/30,1/8,...",
        Suggestion::TrustTimes => "use --trust-times to merge anyway and ignore inconsistent pixels",
        Suggestion::Response => "specify the response curve with --response srgb, linear or FILE.csv",
        Suggestion::Separately => "pass one photograph at a time, or use `gonio batch IMAGE... -o DIR` for several",
        Suggestion::SecondAzimuth => "specify the angle with --second-azimuth DEGREES",
        Suggestion::SecondOutline => "specify the outline of the ball with --second-circle X,Y,RADIUS",
        Suggestion::SecondMask => "specify a mask with --second-mask FILE",
        Suggestion::OtherFolder => "specify another folder with -o DIR",
        Suggestion::LearnPosterior => {
            "train one with `gonio train posterior` and add it with `gonio train model --posterior`, or use another --method"
        }
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
    Some(format!("use {}{others}", options(first)))
}

/// Lists the option of each circle, numbered as in the picture of `gonio check`.
fn one_of(circles: &[Circle]) -> Option<String> {
    let option = |circle: &Circle| format!("--circle {:.1},{:.1},{:.1}", circle.x, circle.y, circle.radius);
    let numbered = |(at, circle): (usize, &Circle)| format!("({}) {}", at + 1, option(circle));
    match circles {
        [] => None,
        [one] => Some(format!("specify {} if that is the ball", option(one))),
        several => {
            let listed: Vec<String> = several.iter().enumerate().map(numbered).collect();
            Some(format!("select one, as numbered in the image that gonio check writes: {}", listed.join(", ")))
        }
    }
}

/// Words warnings for the user of the program.
pub(crate) fn worded(warnings: &[Warning]) -> Vec<String> {
    warnings.iter().map(|warning| warning.worded(&words)).collect()
}

/// Words a problem for the user of the program.
pub(crate) fn plain(problem: AppError) -> anyhow::Error {
    anyhow::Error::msg(problem.worded(&words))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_corrections_as_options() {
        let flip = Correction { flip_y: true, ..Correction::default() };
        let swap = Correction { order: [1, 0, 2], ..flip };
        let worded = words(&Suggestion::NormalAxes(vec![flip, swap])).unwrap();
        assert_eq!(worded, "use --normals-flip-y (or --normals-order yxz --normals-flip-y)");
        assert_eq!(words(&Suggestion::NormalAxes(Vec::new())), None);
    }

    #[test]
    fn words_circles_as_options() {
        let circles = [30.04, 50.0].map(|x| Circle { x, y: 40.0, radius: 20.26 }).to_vec();
        assert!(
            words(&Suggestion::OneOf(circles.clone()))
                .unwrap()
                .ends_with(": (1) --circle 30.0,40.0,20.3, (2) --circle 50.0,40.0,20.3")
        );
        assert_eq!(
            words(&Suggestion::OneOf(circles[..1].to_vec())).unwrap(),
            "specify --circle 30.0,40.0,20.3 if that is the ball"
        );
        assert_eq!(words(&Suggestion::OneOf(Vec::new())), None);
    }
}
