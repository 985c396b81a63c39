//! Distances by Vincenty's method, as it is usually written: what ours is compared with.

use stoop::geodesy::{FLATTENING, Geodetic, SEMI_MAJOR_M, SEMI_MINOR_M};

/// Steps that Vincenty's iteration is given.
const VINCENTY_STEPS: usize = 1000;

/// Vincenty 1975, inverse; metres. `None` where λ does not settle.
pub fn vincenty_m(from: Geodetic, to: Geodetic) -> Option<f64> {
    let (f, b) = (FLATTENING, SEMI_MINOR_M);
    let l = to.lon_rad - from.lon_rad;
    let [(sin1, cos1), (sin2, cos2)] = [from, to].map(|place| ((1.0 - f) * place.lat_rad.tan()).atan().sin_cos());
    let mut lambda = l;
    for _ in 0..VINCENTY_STEPS {
        let (sin_l, cos_l) = lambda.sin_cos();
        let sin_sigma = (cos2 * sin_l).hypot(cos1 * sin2 - sin1 * cos2 * cos_l);
        if sin_sigma == 0.0 {
            return Some(0.0);
        }
        let cos_sigma = sin1 * sin2 + cos1 * cos2 * cos_l;
        let sigma = sin_sigma.atan2(cos_sigma);
        let sin_alpha = cos1 * cos2 * sin_l / sin_sigma;
        let cos_sq = 1.0 - sin_alpha * sin_alpha;
        let cos_2m = if cos_sq == 0.0 { 0.0 } else { cos_sigma - 2.0 * sin1 * sin2 / cos_sq };
        let c = f / 16.0 * cos_sq * (4.0 + f * (4.0 - 3.0 * cos_sq));
        let turn = cos_2m + c * cos_sigma * (2.0 * cos_2m * cos_2m - 1.0);
        let next = l + (1.0 - c) * f * sin_alpha * (sigma + c * sin_sigma * turn);
        if (next - lambda).abs() < 1e-12 {
            let u_sq = cos_sq * (SEMI_MAJOR_M * SEMI_MAJOR_M - b * b) / (b * b);
            let a = 1.0 + u_sq / 16384.0 * (4096.0 + u_sq * (u_sq * (320.0 - 175.0 * u_sq) - 768.0));
            let big_b = u_sq / 1024.0 * (256.0 + u_sq * (u_sq * (74.0 - 47.0 * u_sq) - 128.0));
            let third = big_b / 6.0 * cos_2m * (4.0 * sin_sigma * sin_sigma - 3.0) * (4.0 * cos_2m * cos_2m - 3.0);
            let delta =
                big_b * sin_sigma * (cos_2m + big_b / 4.0 * (cos_sigma * (2.0 * cos_2m * cos_2m - 1.0) - third));
            return Some(b * a * (sigma - delta));
        }
        lambda = next;
    }
    None
}
