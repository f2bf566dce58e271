//! What plots show, whatever the data.
#![allow(clippy::unwrap_used, reason = "a test ends there")]

use glebe_io::output::SVG_MARK;
use glebe_report::{
    Axis, Draught, FurrowView, Mark, Plot, Profile, Series, Style, Window, draught_force, energies,
    furrow_profile,
};

/// The file, read by an XML parser: it must be well-formed.
fn parsed(svg: &str) -> roxmltree::Document<'_> {
    assert!(svg.starts_with(SVG_MARK), "the mark by which --force knows its own files");
    roxmltree::Document::parse(svg).unwrap()
}

fn texts(svg: &str) -> Vec<String> {
    parsed(svg)
        .descendants()
        .filter(|n| n.has_tag_name("text"))
        .map(|n| n.text().unwrap().to_owned())
        .collect()
}

/// All coordinates that are drawn with the series' colours, by series.
fn curves(svg: &str) -> Vec<Vec<[f64; 2]>> {
    let number = |text: &str| text.parse::<f64>().unwrap();
    parsed(svg)
        .descendants()
        .filter(|n| n.attribute("class") == Some("curve") && n.parent().is_some_and(|p| p.has_tag_name("g")))
        .map(|n| {
            let path = n.attribute("d").unwrap();
            path.split(['M', 'L'])
                .filter(|p| !p.is_empty())
                .map(|p| {
                    p.trim_end_matches("h0.5").split_once(' ').map(|(x, y)| [number(x), number(y)]).unwrap()
                })
                .collect()
        })
        .collect()
}

fn line<'a>(name: &'a str, x: &'a [f64], y: &'a [f64]) -> Series<'a> {
    Series { name, x, y, style: Style::Line }
}

#[test]
fn values_are_where_the_axes_say() {
    let (x, y) = ([0.0, 1.0, 2.0], [0.0, 10.0, 5.0]);
    let plot = Plot {
        x: Axis::new("time", "s").with_range(0.0, 2.0),
        y: Axis::new("force", "N").with_range(0.0, 10.0),
        series: vec![line("f", &x, &y)],
        ..Plot::default()
    };
    let svg = plot.to_svg();
    let [a, b, c] = curves(&svg)[0][..] else { unreachable!() };
    assert!((b[0] - a[0] - (c[0] - b[0])).abs() < 0.11, "equal times, equal lengths");
    assert!((a[1] - b[1] - 2.0 * (c[1] - b[1])).abs() < 0.21, "y upwards, in proportion");
    let texts = texts(&svg);
    for expected in ["time (s)", "force (N)", "0.0", "2.0", "10"] {
        assert!(texts.iter().any(|t| t == expected), "{expected} in {texts:?}");
    }
}

#[test]
fn text_from_scenes_is_escaped() {
    let name = "<script>alert(\"&\")</script>\u{7}";
    let plot = Plot {
        title: name,
        x: Axis::new(name, name),
        series: vec![line(name, &[0.0, 1.0], &[1.0, 2.0]), line("b", &[0.0], &[1.0])],
        marks: vec![Mark { x: 0.5, label: name }],
        windows: vec![Window { x: [0.2, 0.4], label: name, mean_std: Some([1.5, 0.1]) }],
        ..Plot::default()
    };
    let svg = plot.to_svg();
    assert!(!svg.contains("<script"));
    assert!(texts(&svg).contains(&"<script>alert(\"&\")</script> ".to_owned()));
}

#[test]
fn any_data_give_a_plot() {
    let odd = [f64::NAN, f64::INFINITY, -1.0, 0.0, 1e-300, 1e300, f64::MAX, f64::MIN];
    for data in [&[][..], &odd[..1], &odd[2..3], &odd] {
        for style in [Style::Line, Style::Dashed, Style::Points] {
            for log in [false, true] {
                let y = Axis::new("y", "");
                let plot = Plot {
                    y: if log { y.log() } else { y },
                    series: vec![Series { name: "a", x: data, y: data, style }],
                    marks: vec![Mark { x: f64::NAN, label: "never" }],
                    windows: vec![Window { x: [f64::NAN, 1.0], label: "w", mean_std: Some([f64::NAN; 2]) }],
                    equal_units: !log,
                    ..Plot::default()
                };
                let svg = plot.to_svg();
                let shown = data.iter().any(|&v| v.is_finite() && (v > 0.0 || !log));
                assert_eq!(texts(&svg).contains(&"no values to show".to_owned()), !shown);
                assert!(!svg.contains("NaN\"") && !svg.contains("inf"), "{svg}");
            }
        }
    }
}

#[test]
fn gaps_interrupt_a_line() {
    let y = [1.0, 2.0, f64::NAN, 3.0, f64::NAN, 4.0, 5.0];
    let x = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    let svg = Plot { series: vec![line("", &x, &y)], ..Plot::default() }.to_svg();
    assert_eq!(curves(&svg)[0].len(), 5);
    let document = parsed(&svg);
    let path = document.descendants().find(|n| n.attribute("class") == Some("curve")).unwrap();
    let path = path.attribute("d").unwrap();
    assert_eq!((path.matches('M').count(), path.matches("h0.5").count()), (3, 1), "{path}");
}

/// A long noisy series becomes a small file, and no peak is lost from the picture.
#[test]
fn long_series_are_thinned_without_losing_peaks() {
    let n = 400_000;
    let x: Vec<f64> = (0..n).map(|k| f64::from(k) / f64::from(n)).collect();
    let mut y: Vec<f64> = x.iter().map(|x| (x * 5e4).sin()).collect();
    y[123_456] = 10.0;
    y[234_567] = -10.0;
    let svg = Plot { series: vec![line("", &x, &y)], ..Plot::default() }.to_svg();
    assert!(svg.len() < 120_000, "{} bytes", svg.len());
    let curve = &curves(&svg)[0];
    let ordinates = || curve.iter().map(|p| p[1]);
    let (top, bottom) = (ordinates().fold(f64::MAX, f64::min), ordinates().fold(f64::MIN, f64::max));
    let typical = curve[0][1];
    assert!(typical - top > 100.0 && bottom - typical > 100.0, "{top} {typical} {bottom}");
}

#[test]
fn the_draught_plot_states_what_was_measured() {
    let displacement: Vec<f64> = (0..=560).map(|k| f64::from(k) * 1e-3).collect();
    let force: Vec<f64> = displacement.iter().map(|x| 309.5 * (x / 0.2).min(1.0)).collect();
    let svg = draught_force(&Draught {
        displacement: &displacement,
        force: &force,
        window: Some([0.28, 0.56]),
        mean_std: Some([309.512, 14.46]),
    });
    let texts = texts(&svg);
    for expected in
        ["displacement of the tool (m)", "draught force (N)", "mean in the window: 309.5 \u{b1} 14.5 N"]
    {
        assert!(texts.iter().any(|t| t == expected), "{expected} in {texts:?}");
    }
    let plain =
        draught_force(&Draught { displacement: &displacement, force: &force, window: None, mean_std: None });
    assert_eq!(curves(&plain)[0].len(), displacement.len());
}

#[test]
fn the_energy_plot_names_curves_and_stages() {
    let time = [0.0, 1.0, 2.0];
    let (kinetic, potential) = ([1.0, 0.1, 0.0], [5.0, 4.0, 3.0]);
    for (log, shown) in [(false, 3), (true, 2)] {
        let svg = energies(
            &time,
            &[("kinetic", &kinetic), ("potential", &potential)],
            &[(0.0, "settle"), (1.5, "till")],
            log,
        );
        assert_eq!(curves(&svg).iter().map(Vec::len).collect::<Vec<_>>(), [shown, 3]);
        let texts = texts(&svg);
        for expected in ["kinetic", "potential", "settle", "till", "energy (J)"] {
            assert!(texts.iter().any(|t| t == expected), "{expected} in {texts:?}");
        }
    }
}

const VIEW: FurrowView =
    FurrowView { along: 0, across: 1, up: 2, section: [-1.0, 1.0], range: [-0.5, 0.5], bins: 10 };

#[test]
fn a_sphere_is_seen_as_a_circle() {
    let fine = FurrowView { bins: 1000, ..VIEW };
    let profile = furrow_profile(&[[0.0, 0.1, 2.0]], &[0.2], &fine);
    for (y, height) in profile.across.iter().zip(&profile.height) {
        let aside = (y - 0.1).abs();
        if aside > 0.201 {
            assert!(height.is_nan());
        } else if aside < 0.199 {
            let (inner, outer) = ((aside - 0.0005).max(0.0), aside + 0.0005);
            let circle = |d: f64| 2.0 + (0.04 - d * d).max(0.0).sqrt();
            assert!((circle(outer)..=circle(inner) + 1e-12).contains(height), "{y} {height}");
        }
    }
}

#[test]
fn a_bin_wider_than_a_sphere_holds_its_top() {
    let profile = furrow_profile(&[[0.0, 0.03, 1.0], [0.0, 0.03, 0.5]], &[0.01, 0.01], &VIEW);
    assert_eq!(profile.height[5], 1.01);
    assert_eq!(profile.height.iter().filter(|h| h.is_finite()).count(), 1);
    assert_eq!(profile.level(), Some(1.01));
}

#[test]
fn only_the_section_counts_and_the_rest_is_cut_off() {
    let position = [[1.1, 0.0, 9.0], [0.0, 0.55, 1.0], [0.0, 5.0, 1.0], [0.0, -5.0, 1.0], [f64::NAN; 3]];
    let profile = furrow_profile(&position, &[0.1; 5], &VIEW);
    assert!(profile.height[..9].iter().all(|h| h.is_nan()));
    // The sphere beyond the edge reaches over it by half its radius.
    assert!((profile.height[9] - (1.0 + (0.01_f64 - 0.0025).sqrt())).abs() < 1e-9);

    for broken in [
        FurrowView { bins: 0, ..VIEW },
        FurrowView { up: 3, ..VIEW },
        FurrowView { range: [0.5, 0.5], ..VIEW },
    ] {
        let profile = furrow_profile(&position, &[0.1; 5], &broken);
        assert_eq!((&profile, profile.level()), (&Profile::default(), None));
        assert!(profile.plot(None).contains("no values to show"));
    }
}

/// The furrow of a bed with a V pressed into it has the V's depth, width and place.
#[test]
fn a_pressed_furrow_is_found() {
    let r = 0.005;
    let mut position = Vec::new();
    for i in 0..20 {
        for j in -60..=60 {
            let (x, y) = (f64::from(i) * 2.0 * r, f64::from(j) * 2.0 * r);
            let surface = 0.3 - (0.1 - (y - 0.1).abs()).max(0.0);
            position.extend((0..3).map(|k| [x, y, surface - r - f64::from(k) * 2.0 * r]));
        }
    }
    let view = FurrowView { section: [0.05, 0.15], range: [-0.6, 0.6], bins: 120, ..VIEW };
    let profile = furrow_profile(&position, &vec![r; position.len()], &view);
    let deepest = (0..120).min_by(|&a, &b| profile.height[a].total_cmp(&profile.height[b])).unwrap();
    assert!((profile.across[deepest] - 0.1).abs() <= 0.01);
    assert!((profile.height[deepest] - 0.2).abs() < 2.0 * r);
    assert!(
        profile
            .across
            .iter()
            .zip(&profile.height)
            .all(|(y, h)| (y - 0.1).abs() < 0.12 || (h - 0.3).abs() < 1e-9)
    );

    let svg = profile.plot(Some(0.3));
    assert_eq!(texts(&svg).iter().filter(|t| *t == "undisturbed level").count(), 1);
    // A unit is as long across as upwards: the V's slope is 1 on the screen.
    let curve = &curves(&svg)[0];
    let pixels = (curve[119][0] - curve[0][0]) / (profile.across[119] - profile.across[0]);
    let depth = (curve[deepest][1] - curve[0][1]) / (profile.height[0] - profile.height[deepest]);
    assert!((pixels / depth - 1.0).abs() < 0.01, "{pixels} {depth}");
}
