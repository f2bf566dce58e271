//! The same code compiled for several instruction sets, chosen at run time.

/// Calls a function that is `#[inline(always)]` in a version compiled for the widest vector instructions that
/// this machine has. The arithmetic is the same in every version and is never fused, so every bit is too.
macro_rules! widest {
    ($f:ident $(::<$g:ident: $bound:path>)? ($($arg:ident: $type:ty),* $(,)?)) => {{
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx512f,avx512vl,avx512dq")]
            fn avx512$(<$g: $bound>)?($($arg: $type),*) {
                $f$(::<$g>)?($($arg),*);
            }
            #[target_feature(enable = "avx2")]
            fn avx2$(<$g: $bound>)?($($arg: $type),*) {
                $f$(::<$g>)?($($arg),*);
            }
            if std::arch::is_x86_feature_detected!("avx512f")
                && std::arch::is_x86_feature_detected!("avx512vl")
                && std::arch::is_x86_feature_detected!("avx512dq")
            {
                // SAFETY: the features that the callee is compiled for were just found on this machine.
                #[allow(unsafe_code)]
                return unsafe { avx512$(::<$g>)?($($arg),*) };
            }
            if std::arch::is_x86_feature_detected!("avx2") {
                // SAFETY: as above.
                #[allow(unsafe_code)]
                return unsafe { avx2$(::<$g>)?($($arg),*) };
            }
        }
        $f$(::<$g>)?($($arg),*)
    }};
}
