//! Draws wide lines and filled rectangles without anti-aliasing.
//!
//! Every pixel equals Pillow's, which the public implementation of the tasks uses. x runs to the right and y down.

/// A frame to draw on. All its pixels are 0 at first.
pub(super) struct Canvas<'a> {
    pixels: &'a mut [u8],
    width: usize,
}

impl<'a> Canvas<'a> {
    /// A canvas over `pixels`, row by row.
    pub(super) fn new(pixels: &'a mut [u8], width: usize) -> Self {
        pixels.fill(0);
        Self { pixels, width }
    }

    /// Fills a rectangle, both corners included.
    pub(super) fn rectangle(&mut self, from: [f64; 2], to: [f64; 2]) {
        let ([left, top], [right, bottom]) = (whole(from), whole(to));
        for y in top..=bottom {
            self.span(y, left, right);
        }
    }

    /// Draws a line that is `width` pixels wide, half of them on either side. An odd pixel lies on the right, seen along the
    /// line.
    pub(super) fn line(&mut self, from: [f64; 2], to: [f64; 2], width: u32) {
        let ([x0, y0], [x1, y1]) = (whole(from), whole(to));
        let [dx, dy] = [x1 - x0, y1 - y0].map(f64::from);
        let length = (dx * dx + dy * dy).sqrt();
        if length == 0.0 {
            return self.span(y0, x0, x0);
        }
        let half = f64::from(width - 1) / 2.0;
        let wide = |along: f64| half_down(half_up(half) / length * along) as i32;
        let narrow = |along: f64| half_down(half_down(half) / length * along) as i32;
        self.polygon([
            [x0 - narrow(dy), y0 + wide(dx)],
            [x1 - narrow(dy), y1 + wide(dx)],
            [x1 + wide(dy), y1 - narrow(dx)],
            [x0 + wide(dy), y0 - narrow(dx)],
        ]);
    }

    /// Fills a quadrilateral and draws its horizontal edges.
    fn polygon(&mut self, corners: [[i32; 2]; 4]) {
        let edges: [_; 4] = std::array::from_fn(|i| (corners[i], corners[(i + 1) % 4]));
        let rows = corners.map(|[_, y]| y);
        let (top, bottom) = rows.iter().fold((rows[0], rows[0]), |(top, bottom), &y| (top.min(y), bottom.max(y)));
        for ([x0, y0], [x1, _]) in edges.into_iter().filter(|([_, y0], [_, y1])| y0 == y1) {
            self.span(y0, x0.min(x1), x0.max(x1));
        }
        for y in top..=bottom {
            let mut crossings = Vec::with_capacity(8);
            for ([x0, y0], [x1, y1]) in edges {
                if y0 == y1 || !(y0.min(y1)..=y0.max(y1)).contains(&y) {
                    continue;
                }
                let slope = (x1 - x0) as f32 / (y1 - y0) as f32;
                let x = (y - y0) as f32 * slope + x0 as f32;
                // An edge that ends here meets the next one, unless the polygon ends too.
                let times = if y == y0.max(y1) && y < bottom { 2 } else { 1 };
                crossings.extend(std::iter::repeat_n(f64::from(x), times));
            }
            crossings.sort_by(f64::total_cmp);
            for pair in crossings.as_chunks::<2>().0 {
                self.span(y, half_up(pair[0]) as i32, half_down(pair[1]) as i32);
            }
        }
    }

    /// Sets the pixels of row `y` from `left` to `right` that are in the frame to 255.
    fn span(&mut self, y: i32, left: i32, right: i32) {
        let (left, right) = (left.max(0), right.min(self.width as i32 - 1));
        if left > right {
            return;
        }
        let row = usize::try_from(y).ok().and_then(|y| self.pixels.chunks_exact_mut(self.width).nth(y));
        if let Some(row) = row {
            row[left as usize..=right as usize].fill(255);
        }
    }
}

/// The pixel of a point: its coordinates truncated towards zero.
fn whole(point: [f64; 2]) -> [i32; 2] {
    point.map(|v| v as i32)
}

/// Rounds to the nearest whole number, halves away from zero.
fn half_up(v: f64) -> f64 {
    (v.abs() + 0.5).floor().copysign(v)
}

/// Rounds to the nearest whole number, halves towards zero.
fn half_down(v: f64) -> f64 {
    (v.abs() - 0.5).ceil().copysign(v)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lit(draw: impl Fn(&mut Canvas<'_>)) -> Vec<(usize, usize)> {
        let mut pixels = [7; 20 * 20];
        draw(&mut Canvas::new(&mut pixels, 20));
        assert!(pixels.iter().all(|&p| p == 0 || p == 255));
        (0..400).filter(|&at| pixels[at] == 255).map(|at| (at / 20, at % 20)).collect()
    }

    #[test]
    fn a_rectangle_holds_both_corners_and_ends_at_the_frame() {
        assert_eq!(lit(|canvas| canvas.rectangle([2.9, 1.0], [4.1, 2.5])).len(), 3 * 2);
        assert_eq!(lit(|canvas| canvas.rectangle([-5.0, -5.0], [50.0, 50.0])).len(), 400);
        assert_eq!(lit(|canvas| canvas.rectangle([-5.0, 3.0], [-2.0, 9.0])), []);
    }

    #[test]
    fn an_upright_line_is_as_wide_as_asked() {
        for width in 2..=6 {
            let pixels = lit(|canvas| canvas.line([10.0, 15.0], [10.0, 5.0], width));
            assert_eq!(pixels.len(), 11 * width as usize, "width {width}");
        }
    }

    #[test]
    fn a_line_without_length_is_one_pixel() {
        assert_eq!(lit(|canvas| canvas.line([3.2, 4.8], [3.9, 4.1], 5)), [(4, 3)]);
    }

    #[test]
    fn a_line_out_of_the_frame_is_cut_there() {
        assert!(!lit(|canvas| canvas.line([10.0, 10.0], [300.0, -200.0], 4)).is_empty());
        assert_eq!(lit(|canvas| canvas.line([30.0, 40.0], [300.0, 200.0], 4)), []);
    }
}
