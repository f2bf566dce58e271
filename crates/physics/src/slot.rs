//! The registry of laws: one row per law.

/// Declares the laws of a slot. Each row `file::Type` declares the module `file` and enters the law
/// `Type` into the slot's enum.
///
/// Laws are chosen by name, at run time, yet no contact pays for it: [`visit`] hands the law's type to
/// a loop over contacts, which is compiled once per law.
macro_rules! slot {
    (
        $(#[$doc:meta])* $slot:ident: $kernel:ident
        { $($file:ident::$law:ident),* $(,)? }
        fn $chosen:ident($k:ident: &$coefficients:ident $(, $argument:ident: $type:ident)*) -> $output:ty = $function:ident $call:tt;
    ) => {
        $(pub mod $file;)*
        slot_enum! { $(#[$doc])* $slot: $kernel { $($file::$law),* } }

        /// The function of the law that the kernel is specialised for.
        #[cfg(feature = "gpu")]
        #[cube]
        pub fn $chosen(#[comptime] law: $slot, $k: &$coefficients $(, $argument: $type)*) -> $output {
            match law { $($slot::$law => $file::$law::$function $call),* }
        }
    };
}

/// The same for the f64 twin, whose modules `build.rs` has put in place.
macro_rules! slot_enum {
    (
        $(#[$doc:meta])* $slot:ident: $kernel:ident
        { $($file:ident::$law:ident),* $(,)? }
        $($device:tt)*
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum $slot { $(
            #[doc = concat!("[`", stringify!($file), "::", stringify!($law), "`]")]
            $law
        ),* }

        impl $slot {
            /// Every law of the slot.
            pub const ALL: &'static [Self] = &[$(Self::$law),*];
            /// What users meet of every law of the slot, in the same order.
            pub const INFO: &'static [crate::LawInfo] = &[$(<$file::$law as crate::Law>::INFO),*];

            /// What users meet of the law.
            pub fn info(self) -> &'static crate::LawInfo {
                &Self::INFO[self as usize]
            }
            /// What is remembered per contact, see [`Law::HISTORY`](crate::Law::HISTORY).
            pub fn history(self) -> &'static [f64] {
                match self { $(Self::$law => <$file::$law as crate::Law>::HISTORY),* }
            }
            /// Coefficients for a pair of materials.
            pub fn prepare(self, p: &crate::Preparation<'_>) -> Result<[f64; 4], crate::LawError> {
                match self { $(Self::$law => <$file::$law as crate::Law>::prepare(p)),* }
            }
            /// See [`Law::strength`](crate::Law::strength).
            pub fn strength(self, p: &crate::Preparation<'_>) -> [f64; 4] {
                match self { $(Self::$law => <$file::$law as crate::Law>::strength(p)),* }
            }
            /// See [`Law::FROM_MATERIAL`](crate::Law::FROM_MATERIAL).
            pub fn from_material(self) -> bool {
                match self { $(Self::$law => <$file::$law as crate::Law>::FROM_MATERIAL),* }
            }
            /// Duration of an elastic impact \[s\].
            pub fn collision_time(self, coefficients: &[f64; 4], impact: &crate::Impact, speed: f64) -> f64 {
                match self {
                    $(Self::$law => <$file::$law as crate::Law>::collision_time(coefficients, impact, speed)),*
                }
            }
            /// See [`Law::range`](crate::Law::range).
            pub fn range(self, coefficients: &[f64; 4], radius: f64) -> f64 {
                match self { $(Self::$law => <$file::$law as crate::Law>::range(coefficients, radius)),* }
            }
            /// Runs `visitor` with the law's type.
            #[inline(always)]
            pub fn visit<V: Visitor>(self, visitor: V) -> V::Output {
                match self { $(Self::$law => visitor.visit::<$file::$law>()),* }
            }
        }

        /// Code that is compiled once for each law of the slot.
        pub trait Visitor {
            /// What it returns.
            type Output;
            /// Runs with the law `L`.
            fn visit<L: $kernel + crate::Law>(self) -> Self::Output;
        }
    };
}
