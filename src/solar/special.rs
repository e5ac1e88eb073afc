//! The digamma function, and the multivariate gamma function.

/// ψ(x) for x above 0, within 1e-14 of its magnitude: recurrence, then the asymptotic series.
pub(super) fn digamma(mut x: f64) -> f64 {
    let mut sum = 0.0;
    while x < 10.0 {
        sum -= 1.0 / x;
        x += 1.0;
    }
    let r = 1.0 / (x * x);
    // Bernoulli numbers B_2k / 2k.
    let series = r
        * (1.0 / 12.0
            - r * (1.0 / 120.0
                - r * (1.0 / 252.0
                    - r * (1.0 / 240.0 - r * (1.0 / 132.0 - r * (691.0 / 32760.0 - r * (1.0 / 12.0)))))));
    sum + libm::log(x) - 0.5 / x - series
}

/// ln Γ_d(x), the multivariate gamma function.
pub(super) fn ln_gamma(d: usize, x: f64) -> f64 {
    let n = d as f64;
    let constant = n * (n - 1.0) / 4.0 * libm::log(std::f64::consts::PI);
    constant + (0..d).map(|i| libm::lgamma(x - i as f64 / 2.0)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digamma_has_its_known_values() {
        // ψ(1) = -γ, ψ(1/2) = -γ - 2 ln 2, ψ(10) = 2.2517525890667211….
        let gamma = 0.577_215_664_901_532_9;
        for (x, value) in [(1.0, -gamma), (0.5, -gamma - 2.0 * 2.0_f64.ln()), (10.0, 2.251_752_589_066_721)] {
            assert!((digamma(x) - value).abs() < 1e-14, "{x}: {}", digamma(x));
        }
    }

    #[test]
    fn the_gamma_function_of_one_dimension_is_the_usual_one() {
        assert!((ln_gamma(1, 5.0) - 24.0_f64.ln()).abs() < 1e-14);
    }
}
