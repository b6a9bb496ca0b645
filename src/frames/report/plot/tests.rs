use super::*;

fn series(style: Style, group: usize, points: &[[f64; 2]]) -> Series {
    Series { name: format!("series {group}"), style, group, points: points.to_vec(), marked: Vec::new() }
}

fn chart(series: Vec<Series>) -> Chart {
    Chart {
        title: "error against time".into(),
        x: Axis::log("time, ms"),
        y: Axis::log("error, px"),
        series,
        ring: "chosen".into(),
        notes: vec!["measured".into()],
    }
}

/// Returns the value of `name="..."` in one line of SVG.
fn attribute(line: &str, name: &str) -> Option<f64> {
    let value = line.split(&format!(" {name}=\"")).nth(1)?.split('"').next()?;
    value.parse().ok()
}

fn lines_with<'a>(svg: &'a str, class: &str) -> Vec<&'a str> {
    svg.lines().filter(|line| line.contains(&format!("class=\"{class}\""))).collect()
}

/// Returns places of marks, rings and corners of lines.
fn places(svg: &str) -> Vec<[f64; 2]> {
    let pair = |text: &str| {
        let mut numbers = text.split([' ', ',']).map(|n| n.parse().unwrap());
        [numbers.next().unwrap(), numbers.next().unwrap()]
    };
    let inner =
        |line: &'_ str, start: &str, end: char| line.split(start).nth(1).unwrap().split(end).next().unwrap().to_owned();
    let marks = lines_with(svg, "mark").into_iter().map(|line| pair(&inner(line, "translate(", ')')));
    let rings = lines_with(svg, "ring").into_iter();
    let rings = rings.map(|line| [attribute(line, "cx").unwrap(), attribute(line, "cy").unwrap()]);
    let polylines = svg.lines().filter(|line| line.starts_with("<polyline"));
    let corners = polylines.flat_map(|line| inner(line, "points=\"", '"').split(' ').map(pair).collect::<Vec<_>>());
    marks.chain(rings).chain(corners).collect()
}

fn is_inside_frame(svg: &str, [x, y]: [f64; 2]) -> bool {
    let frame = lines_with(svg, "frame")[0];
    let [left, top, width, height] = ["x", "y", "width", "height"].map(|name| attribute(frame, name).unwrap());
    (left..=left + width).contains(&x) && (top..=top + height).contains(&y)
}

#[test]
fn every_finite_point_is_inside_the_frame() {
    let spread: Vec<[f64; 2]> = (-12..=12).map(|n| [10_f64.powi(n), 10_f64.powi(-n) * 3.0]).collect();
    for scale in [Scale::Log, Scale::Linear] {
        for style in [Style::Points, Style::Line, Style::DashedLine, Style::Front] {
            let mut chart = chart(vec![Series { marked: vec![0, 24, 99], ..series(style, 1, &spread) }]);
            (chart.x.scale, chart.y.scale) = (scale, scale);
            let svg = to_svg(&chart);
            let places = places(&svg);
            assert_eq!(places.len(), 27, "25 points and 2 rings: {scale:?} {style:?}");
            assert!(places.iter().all(|place| is_inside_frame(&svg, *place)), "{scale:?} {style:?}");
            assert!(!is_inside_frame(&svg, [10.0, 10.0]), "the comparison can fail");
        }
    }
}

#[test]
fn a_larger_value_is_further_right_and_up() {
    let svg = to_svg(&chart(vec![series(Style::Points, 0, &[[1.0, 1.0], [10.0, 10.0]])]));
    let places = places(&svg);
    assert!(places[0][0] < places[1][0] && places[0][1] > places[1][1], "{places:?}");
}

#[test]
fn points_without_a_place_are_left_out_and_counted() {
    let points = [[1.0, 1.0], [0.0, 1.0], [2.0, -1.0], [f64::NAN, 1.0], [3.0, f64::INFINITY], [4.0, 2.0]];
    let log = to_svg(&chart(vec![series(Style::Points, 0, &points)]));
    assert_eq!(lines_with(&log, "mark").len(), 2);
    assert!(log.contains("4 points have no place"), "{log}");
    let linear = Chart { x: Axis::linear("x"), y: Axis::linear("y"), ..chart(vec![series(Style::Points, 0, &points)]) };
    let linear = to_svg(&linear);
    assert_eq!(lines_with(&linear, "mark").len(), 4, "zero and negative have a place");
    assert!(linear.contains("2 points have no place"));
    assert!(!to_svg(&chart(vec![series(Style::Points, 0, &points[..1])])).contains("no place"), "nothing to say");
}

#[test]
fn a_point_that_is_left_out_interrupts_a_line() {
    let svg =
        to_svg(&chart(vec![series(Style::Line, 0, &[[1.0, 1.0], [2.0, 2.0], [3.0, 0.0], [4.0, 1.0], [5.0, 1.0]])]));
    assert_eq!(svg.lines().filter(|line| line.starts_with("<polyline")).count(), 2);
}

#[test]
fn nothing_to_draw_breaks_nothing() {
    for series in [vec![], vec![series(Style::Line, 0, &[])], vec![series(Style::Points, 3, &[[0.0, 0.0]])]] {
        let svg = to_svg(&chart(series));
        assert!(svg.ends_with("</svg>\n") && places(&svg).is_empty(), "{svg}");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}

#[test]
fn text_is_escaped() {
    let mut chart = chart(vec![series(Style::Points, 0, &[[1.0, 1.0]])]);
    chart.title = "a < b & \"c\" > d\u{7}".into();
    chart.series[0].name = "</text><script>".into();
    let svg = to_svg(&chart);
    assert!(svg.contains("a &lt; b &amp; &quot;c&quot; &gt; d "), "{svg}");
    assert!(!svg.contains("<script>") && !svg.contains('\u{7}'), "{svg}");
    assert_eq!(svg.matches('<').count(), svg.matches('>').count());
}

#[test]
fn the_legend_lies_above_the_frame_and_between_the_margins() {
    let many: Vec<Series> = (0..12).map(|group| series(Style::Points, group, &[[1.0, 1.0]])).collect();
    let svg = to_svg(&chart(many));
    let top = attribute(lines_with(&svg, "frame")[0], "y").unwrap();
    let names: Vec<&str> = svg.lines().filter(|line| line.contains(">series ")).collect();
    assert_eq!(names.len(), 12);
    for name in names {
        let [x, y] = ["x", "y"].map(|attr| attribute(name, attr).unwrap());
        assert!(y < top && x + 9.0 * 7.0 < 760.0, "{name}");
    }
}

#[test]
fn the_same_chart_is_the_same_text_and_another_is_not() {
    let sample = chart(vec![series(Style::Points, 0, &[[1.0, 1.0], [2.0, 3.0]])]);
    assert_eq!(to_svg(&sample), to_svg(&sample));
    let moved = chart(vec![series(Style::Points, 0, &[[1.0, 1.0], [2.0, 3.1]])]);
    assert_ne!(to_svg(&sample), to_svg(&moved));
}

#[test]
fn a_ring_is_named_only_where_there_is_one() {
    let mut chart = chart(vec![series(Style::Points, 0, &[[1.0, 1.0]])]);
    assert!(!to_svg(&chart).contains(">chosen<"));
    chart.series[0].marked.push(0);
    let svg = to_svg(&chart);
    assert!(svg.contains(">chosen<") && lines_with(&svg, "ring").len() == 1, "{svg}");
}
