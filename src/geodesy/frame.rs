//! Frames are types: a transform from one frame does not apply to a point of another.

use glam::{DMat3, DVec3};
use std::fmt;
use std::marker::PhantomData;
use std::ops::{Add, Mul, Sub};

/// Earth-centred, Earth-fixed: x through (0°, 0°), z through the north pole; metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ecef {}
/// A local tangent frame: x east, y north, z up; metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Enu {}

macro_rules! typed_vec3 {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        pub struct $name<F>(DVec3, PhantomData<fn() -> F>);

        impl<F> $name<F> {
            pub const fn new(xyz: DVec3) -> Self {
                Self(xyz, PhantomData)
            }

            pub const fn xyz(&self) -> DVec3 {
                self.0
            }
        }

        impl<F> Clone for $name<F> {
            fn clone(&self) -> Self {
                *self
            }
        }

        impl<F> Copy for $name<F> {}

        impl<F> PartialEq for $name<F> {
            fn eq(&self, other: &Self) -> bool {
                self.0 == other.0
            }
        }

        impl<F> fmt::Debug for $name<F> {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{}({}, {}, {})", stringify!($name), self.0.x, self.0.y, self.0.z)
            }
        }
    };
}

typed_vec3!(
    /// A position in frame `F`, metres.
    Point
);
typed_vec3!(
    /// A difference of positions in frame `F`, metres.
    Vector
);

impl<F> Point<F> {
    pub fn distance_m(&self, other: Point<F>) -> f64 {
        self.0.distance(other.0)
    }
}

impl<F> Sub for Point<F> {
    type Output = Vector<F>;

    fn sub(self, other: Self) -> Vector<F> {
        Vector::new(self.0 - other.0)
    }
}

impl<F> Add<Vector<F>> for Point<F> {
    type Output = Point<F>;

    fn add(self, offset: Vector<F>) -> Point<F> {
        Point::new(self.0 + offset.0)
    }
}

/// A rigid motion that takes coordinates in `From` to coordinates in `To`; reads right to left:
/// `enu_from_ecef * point`.
pub struct Transform<To, From> {
    rotation: DMat3,
    translation: DVec3,
    frames: PhantomData<fn(From) -> To>,
}

impl<To, From> PartialEq for Transform<To, From> {
    fn eq(&self, other: &Self) -> bool {
        self.rotation == other.rotation && self.translation == other.translation
    }
}

impl<To, From> Clone for Transform<To, From> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<To, From> Copy for Transform<To, From> {}

impl<To, From> fmt::Debug for Transform<To, From> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Transform({:?}, {:?})", self.rotation, self.translation)
    }
}

impl<To, From> Transform<To, From> {
    /// `rotation` must be orthonormal; `translation` is the origin of `From` in `To`.
    pub const fn new(rotation: DMat3, translation: DVec3) -> Self {
        Self { rotation, translation, frames: PhantomData }
    }

    pub fn inverse(&self) -> Transform<From, To> {
        let rotation = self.rotation.transpose();
        Transform::new(rotation, -(rotation * self.translation))
    }

    pub fn rotation(&self) -> DMat3 {
        self.rotation
    }

    pub fn origin(&self) -> Point<To> {
        Point::new(self.translation)
    }
}

impl<To, From> Mul<Point<From>> for Transform<To, From> {
    type Output = Point<To>;

    fn mul(self, point: Point<From>) -> Point<To> {
        Point::new(self.rotation * point.0 + self.translation)
    }
}

impl<To, From> Mul<Vector<From>> for Transform<To, From> {
    type Output = Vector<To>;

    fn mul(self, vector: Vector<From>) -> Vector<To> {
        Vector::new(self.rotation * vector.0)
    }
}

impl<A, B, C> Mul<Transform<B, C>> for Transform<A, B> {
    type Output = Transform<A, C>;

    fn mul(self, inner: Transform<B, C>) -> Transform<A, C> {
        Transform::new(self.rotation * inner.rotation, self.rotation * inner.translation + self.translation)
    }
}
