//! Vector instructions, chosen at run time.

use pulp::{Arch, Simd, WithSimd};

/// Runs code that was compiled once more for each set of vector instructions, with the widest that
/// this processor has. The closure, and what it calls, must be `#[inline(always)]`.
#[inline(always)]
pub fn vectorized<R>(kernel: impl FnMut() -> R) -> R {
    struct Kernel<F>(F);
    impl<R, F: FnMut() -> R> WithSimd for Kernel<F> {
        type Output = R;
        #[inline(always)]
        fn with_simd<S: Simd>(mut self, _: S) -> R {
            (self.0)()
        }
    }
    Arch::new().dispatch(Kernel(kernel))
}
