//! Double-double arithmetic (Dekker 1971; Hida, Li, Bailey 2001): about 31 digits, to tell which of two doubles is off.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// An unevaluated sum `hi + lo`, `|lo|` at most half a unit in the last place of `hi`.
#[derive(Clone, Copy, Debug)]
pub struct Exact {
    hi: f64,
    lo: f64,
}

impl From<f64> for Exact {
    fn from(value: f64) -> Self {
        Self { hi: value, lo: 0.0 }
    }
}

fn two_sum(a: f64, b: f64) -> Exact {
    let hi = a + b;
    let part = hi - a;
    Exact { hi, lo: (a - (hi - part)) + (b - part) }
}

impl Add for Exact {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let (s, t) = (two_sum(self.hi, other.hi), two_sum(self.lo, other.lo));
        let s = two_sum(s.hi, s.lo + t.hi);
        two_sum(s.hi, s.lo + t.lo)
    }
}

impl Neg for Exact {
    type Output = Self;
    fn neg(self) -> Self {
        Self { hi: -self.hi, lo: -self.lo }
    }
}

impl Sub for Exact {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Exact {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let hi = self.hi * other.hi;
        let lo = self.hi.mul_add(other.hi, -hi) + (self.hi * other.lo + self.lo * other.hi);
        two_sum(hi, lo)
    }
}

impl Div for Exact {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let first = Self::from(self.hi / other.hi);
        let rest = self - first * other;
        let second = Self::from(rest.hi / other.hi);
        let rest = rest - second * other;
        first + second + Self::from(rest.hi / other.hi)
    }
}

impl Exact {
    pub fn to_f64(self) -> f64 {
        self.hi + self.lo
    }

    pub fn sqrt(self) -> Self {
        let first = Self::from(self.hi.sqrt());
        let half = Self::from(0.5);
        let second = half * (first + self / first);
        half * (second + self / second)
    }

    /// Sine and cosine, to about 10⁻²⁹, of an angle within ±2π.
    pub fn sin_cos(self) -> (Self, Self) {
        const HALVINGS: i32 = 8;
        let x = self * Self::from(0.5f64.powi(HALVINGS));
        let xx = x * x;
        // sin x and 1 − cos x by their series; doubling 1 − cos keeps what cos would lose.
        let (mut sin, mut versine) = (x, Self::from(0.0));
        let (mut sin_term, mut cos_term) = (x, Self::from(-1.0));
        for n in 1..12 {
            let n = f64::from(n);
            cos_term = -(cos_term * xx) / Self::from((2.0 * n - 1.0) * (2.0 * n));
            versine = versine + cos_term;
            sin_term = -(sin_term * xx) / Self::from((2.0 * n) * (2.0 * n + 1.0));
            sin = sin + sin_term;
        }
        let (one, two) = (Self::from(1.0), Self::from(2.0));
        for _ in 0..HALVINGS {
            (sin, versine) = (two * sin * (one - versine), two * sin * sin);
        }
        (sin, one - versine)
    }
}

/// Geodetic to ECEF on WGS84, exactly as far as 31 digits go; angles in radians.
pub fn ecef(lat_rad: f64, lon_rad: f64, height_m: f64) -> [Exact; 3] {
    let (sin_lat, cos_lat) = Exact::from(lat_rad).sin_cos();
    let (sin_lon, cos_lon) = Exact::from(lon_rad).sin_cos();
    let (one, height) = (Exact::from(1.0), Exact::from(height_m));
    let f = one / Exact::from(298.257_223_563);
    let e2 = f * (Exact::from(2.0) - f);
    let n = Exact::from(6_378_137.0) / (one - e2 * sin_lat * sin_lat).sqrt();
    let across = (n + height) * cos_lat;
    [across * cos_lon, across * sin_lon, (n * (one - e2) + height) * sin_lat]
}

/// Distance of a double's position from an exact one, metres.
pub fn distance_m(exact: [Exact; 3], xyz: [f64; 3]) -> f64 {
    let square = (0..3).map(|axis| (exact[axis] - Exact::from(xyz[axis])).to_f64().powi(2)).sum::<f64>();
    square.sqrt()
}

#[test]
fn thirty_digits_are_right() {
    let third = Exact::from(1.0) / Exact::from(3.0);
    assert!((third * Exact::from(3.0) - Exact::from(1.0)).to_f64().abs() < 1e-31);
    let root = Exact::from(2.0).sqrt();
    assert!((root * root - Exact::from(2.0)).to_f64().abs() < 1e-30);
    for angle in [0.1, 1.0, std::f64::consts::FRAC_PI_2, -3.0, std::f64::consts::PI] {
        let (sin, cos) = Exact::from(angle).sin_cos();
        assert!((sin * sin + cos * cos - Exact::from(1.0)).to_f64().abs() < 1e-28);
        assert!((sin.to_f64() - f64::sin(angle)).abs() < 2e-16 && (cos.to_f64() - f64::cos(angle)).abs() < 2e-16);
    }
    // sin of the double nearest to π is π less that double: 1.2246467991473532e-16 to all its digits.
    let sin_pi = Exact::from(std::f64::consts::PI).sin_cos().0.to_f64();
    assert!((sin_pi / 1.224_646_799_147_353_2e-16 - 1.0).abs() < 1e-12);
}
