//! Which vector instructions may this CPU run?

use std::fmt;
use std::str::FromStr;
use std::sync::OnceLock;

use fremen::error::{Error, ErrorKind, Result};

/// The environment variable that forces a kernel: `scalar`, `avx2`, `avx512` or `neon`.
pub const KERNEL_VARIABLE: &str = "CHRONOTOPE_KERNEL";

/// The instruction sets that kernels are written for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Kind {
    Scalar,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "aarch64")]
    Neon,
}

/// The instructions that distances are computed with; it exists only if this CPU can run them.
///
/// Every kernel gives the same answers; only their speed differs.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Kernel(pub(super) Kind);

impl Kernel {
    /// The plain twin of all other kernels; runs everywhere.
    pub const fn scalar() -> Self {
        Self(Kind::Scalar)
    }

    /// Every kernel this CPU can run, slowest first; the first one is [`scalar`](Self::scalar).
    pub fn available() -> impl Iterator<Item = Self> {
        [
            Some(Self::scalar()),
            Self::avx2(),
            Self::neon(),
            Self::avx512(),
        ]
        .into_iter()
        .flatten()
    }

    /// The fastest kernel this CPU can run, or the one that [`KERNEL_VARIABLE`] names.
    ///
    /// A value of the variable that cannot be used is ignored here, because answers do not depend
    /// on the kernel; a command calls [`from_env`](Self::from_env) once at its start to report it.
    /// The variable is read once per process.
    pub fn best() -> Self {
        static BEST: OnceLock<Kernel> = OnceLock::new();
        *BEST.get_or_init(|| Self::from_env().unwrap_or_else(|_| Self::detect()))
    }

    /// What [`KERNEL_VARIABLE`] names, the fastest kernel where it is unset or empty, and an
    /// [`ErrorKind::Config`] error where its value is unknown or not for this CPU.
    pub fn from_env() -> Result<Self> {
        match std::env::var_os(KERNEL_VARIABLE) {
            None => Ok(Self::detect()),
            Some(value) if value.is_empty() => Ok(Self::detect()),
            Some(value) => value
                .to_string_lossy()
                .parse()
                .map_err(|error: Error| error.with_place(KERNEL_VARIABLE)),
        }
    }

    /// `scalar`, `avx2`, `avx512` or `neon`.
    pub const fn name(self) -> &'static str {
        match self.0 {
            Kind::Scalar => "scalar",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => "avx512",
            #[cfg(target_arch = "aarch64")]
            Kind::Neon => "neon",
        }
    }

    fn detect() -> Self {
        Self::available().last().unwrap_or(Self::scalar())
    }

    #[cfg(target_arch = "x86_64")]
    fn avx2() -> Option<Self> {
        is_x86_feature_detected!("avx2").then_some(Self(Kind::Avx2))
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn avx2() -> Option<Self> {
        None
    }

    #[cfg(target_arch = "x86_64")]
    fn avx512() -> Option<Self> {
        // Every CPU that counts ones of vectors has the others too, but for one accelerator card.
        (is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512vpopcntdq"))
        .then_some(Self(Kind::Avx512))
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn avx512() -> Option<Self> {
        None
    }

    #[cfg(target_arch = "aarch64")]
    fn neon() -> Option<Self> {
        std::arch::is_aarch64_feature_detected!("neon").then_some(Self(Kind::Neon))
    }

    #[cfg(not(target_arch = "aarch64"))]
    fn neon() -> Option<Self> {
        None
    }
}

impl Default for Kernel {
    fn default() -> Self {
        Self::best()
    }
}

impl fmt::Debug for Kernel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Kernel({})", self.name())
    }
}

impl fmt::Display for Kernel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Kernel {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        if let Some(kernel) = Self::available().find(|kernel| kernel.name() == name) {
            return Ok(kernel);
        }
        let message = if ["avx2", "avx512", "neon"].contains(&name) {
            format!("this CPU cannot run the kernel `{name}`")
        } else {
            format!("there is no kernel `{name}`")
        };
        let names: Vec<_> = Self::available().map(Self::name).collect();
        Err(Error::new(ErrorKind::Config, message)
            .with_help(format!("this CPU can run: {}", names.join(", "))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_parse_back_and_strangers_are_refused_with_the_choice() {
        for kernel in Kernel::available() {
            assert_eq!(kernel.name().parse::<Kernel>().unwrap(), kernel);
        }
        let error = "sse9".parse::<Kernel>().unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Config);
        assert!(error.to_string().contains("scalar"), "{error}");
        let absent = if cfg!(target_arch = "aarch64") {
            "avx2"
        } else {
            "neon"
        };
        let error = absent.parse::<Kernel>().unwrap_err();
        assert!(error.to_string().contains("this CPU cannot run"), "{error}");
    }
}
