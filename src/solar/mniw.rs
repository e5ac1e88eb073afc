//! The matrix-normal inverse-Wishart distribution of linear-Gaussian dynamics, MN(F; M, Σ, V) IW(Σ; Ψ, ν).

use super::{Small, gaussian::LN_TAU, special};

/// An MNIW distribution by its usual parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mniw {
    /// Ψ \[d, d\].
    pub psi: Small,
    /// M \[d, p\], the mean of F.
    pub m: Small,
    /// V \[p, p\], the covariance of F's columns in units of Σ.
    pub v: Small,
    /// ν.
    pub nu: f64,
}

/// Natural parameters of an MNIW distribution, or sufficient statistics of data, which are added to them:
/// Σ y⁺y⁺ᵀ, Σ y⁺yᵀ, Σ yyᵀ and the count of transitions (y, y⁺).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Natural {
    /// Ψ + M V⁻¹ Mᵀ, \[d, d\].
    pub n1: Small,
    /// M V⁻¹, \[d, p\].
    pub n2: Small,
    /// V⁻¹, \[p, p\].
    pub n3: Small,
    /// ν + d + p + 1.
    pub n4: f64,
}

/// The expectation of the sufficient statistic (-½ Σ⁻¹, Σ⁻¹F, -½ FᵀΣ⁻¹F, -½ ln|Σ|).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Expected {
    /// E\[-½ Σ⁻¹\], \[d, d\].
    pub e1: Small,
    /// E\[Σ⁻¹F\], \[d, p\].
    pub e2: Small,
    /// E\[-½ FᵀΣ⁻¹F\], \[p, p\].
    pub e3: Small,
    /// E\[-½ ln|Σ|\].
    pub e4: f64,
}

impl Mniw {
    /// The prior of all dynamics: Ψ = 2I, M = \[I 0\], V = I and ν = d + 2, so that E Σ = 2I.
    pub fn prior(d: usize, p: usize) -> Self {
        Self {
            psi: Small::diagonal(d, 2.0),
            m: Small::from_fn(d, p, |i, j| if i == j { 1.0 } else { 0.0 }),
            v: Small::diagonal(p, 1.0),
            nu: d as f64 + 2.0,
        }
    }

    fn d(&self) -> usize {
        self.m.rows()
    }

    fn p(&self) -> usize {
        self.m.columns()
    }

    /// The natural parameters; `None` if V is not positive definite.
    pub fn natural(&self) -> Option<Natural> {
        let (n3, _) = self.v.inverse()?;
        let n2 = self.m.times(&n3);
        let n1 = self.psi.plus(1.0, &n2.times_transposed(&self.m));
        Some(Natural { n1, n2, n3, n4: self.nu + (self.d() + self.p() + 1) as f64 })
    }

    /// E t; `None` if Ψ is not positive definite.
    pub fn expected(&self) -> Option<Expected> {
        let d = self.d();
        let (inverse, log_determinant) = self.psi.inverse()?;
        let e2 = inverse.times(&self.m).scaled(self.nu);
        let e3 = self.m.transposed_times(&e2).plus(d as f64, &self.v).scaled(-0.5).symmetric();
        let digammas: f64 = (0..d).map(|i| special::digamma((self.nu - i as f64) / 2.0)).sum();
        let e4 = 0.5 * (d as f64 * std::f64::consts::LN_2 - log_determinant + digammas);
        Some(Expected { e1: inverse.scaled(-0.5 * self.nu), e2, e3, e4 })
    }

    /// E Σ = Ψ / (ν - d - 1).
    pub fn expected_sigma(&self) -> Small {
        self.psi.scaled(1.0 / (self.nu - self.d() as f64 - 1.0))
    }

    /// ln Z, the log normaliser; `None` if Ψ or V is not positive definite.
    pub fn log_normalizer(&self) -> Option<f64> {
        let (d, p) = (self.d() as f64, self.p() as f64);
        let (_, log_psi) = self.psi.inverse()?;
        let (_, log_v) = self.v.inverse()?;
        let half = self.nu / 2.0;
        Some(
            half * d * std::f64::consts::LN_2 - half * log_psi
                + special::ln_gamma(self.d(), half)
                + d / 2.0 * log_v
                + d * p / 2.0 * LN_TAU,
        )
    }

    /// KL(self || other) = <n_self - n_other, E t> - ln Z_self + ln Z_other.
    pub fn kl(&self, other: &Self) -> Option<f64> {
        let (own, of_other, expected) = (self.natural()?, other.natural()?, self.expected()?);
        let Expected { e1, e2, e3, e4 } = expected;
        let inner = own.n1.plus(-1.0, &of_other.n1).inner(&e1)
            + own.n2.plus(-1.0, &of_other.n2).inner(&e2)
            + own.n3.plus(-1.0, &of_other.n3).inner(&e3)
            + (own.n4 - of_other.n4) * e4;
        Some(inner - self.log_normalizer()? + other.log_normalizer()?)
    }

    /// The Student-t distribution of the next state after y: its mean \[d\], its shape \[d, d\] and its degrees of
    /// freedom.
    pub fn predictive(&self, y: &Small) -> (Small, Small, f64) {
        let freedom = self.nu - self.d() as f64 + 1.0;
        let shape = self.psi.scaled((1.0 + self.v.quadratic(y)) / freedom);
        (self.m.times(y), shape, freedom)
    }
}

impl Natural {
    /// All zeros: the statistics of no data.
    pub fn zero(d: usize, p: usize) -> Self {
        Self { n1: Small::zeros(d, d), n2: Small::zeros(d, p), n3: Small::zeros(p, p), n4: 0.0 }
    }

    /// self + scale · other.
    #[must_use]
    pub fn plus(&self, scale: f64, other: &Self) -> Self {
        Self {
            n1: self.n1.plus(scale, &other.n1),
            n2: self.n2.plus(scale, &other.n2),
            n3: self.n3.plus(scale, &other.n3),
            n4: self.n4 + scale * other.n4,
        }
    }

    /// The usual parameters; `None` if V⁻¹ is not positive definite.
    pub fn mniw(&self) -> Option<Mniw> {
        let (d, p) = (self.n2.rows(), self.n2.columns());
        let (v, _) = self.n3.inverse()?;
        let m = self.n2.times(&v);
        let psi = self.n1.plus(-1.0, &m.times_transposed(&self.n2)).symmetric();
        Some(Mniw { psi, m, v, nu: self.n4 - (d + p + 1) as f64 })
    }

    /// One natural-gradient step: n + rho/N (prior + N/B · statistics - n) with N trajectories in all and B in the batch.
    /// It is a convex combination, so Ψ and V stay positive definite while rho/N is below 1.
    #[must_use]
    pub fn step(&self, prior: &Self, statistics: &Self, rho: f64, trajectories: f64, batch: f64) -> Self {
        let target = prior.plus(trajectories / batch, statistics);
        self.plus(rho / trajectories, &target.plus(-1.0, self))
    }
}
