//! Which points are taken for the ground.

use std::fmt;
use std::str::FromStr;

/// Classes of points, as a set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ClassSet([u64; 4]);

impl ClassSet {
    /// Those that the LAS specification calls ground and water.
    pub const GROUND: ClassSet = ClassSet([1 << 2 | 1 << 9, 0, 0, 0]);

    /// The set with another one.
    pub fn with(mut self, class: u8) -> ClassSet {
        self.0[usize::from(class / 64)] |= 1 << (class % 64);
        self
    }

    /// Whether a class is one of them.
    pub fn has(self, class: u8) -> bool {
        self.0[usize::from(class / 64)] >> (class % 64) & 1 != 0
    }

    /// They, in order.
    pub fn iter(self) -> impl Iterator<Item = u8> {
        (0..=u8::MAX).filter(move |class| self.has(*class))
    }
}

impl FromIterator<u8> for ClassSet {
    fn from_iter<I: IntoIterator<Item = u8>>(classes: I) -> ClassSet {
        classes.into_iter().fold(ClassSet::default(), ClassSet::with)
    }
}

/// What tells the ground of [`super::open::Kind::Ground`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Classes {
    /// Classes 2 (ground) and 9 (water), if any point of class 2 is there; else a filter.
    #[default]
    Auto,
    /// The filter, whatever classes say.
    None,
    /// These classes.
    Of(ClassSet),
}

impl FromStr for Classes {
    type Err = String;

    /// `auto`, `none`, or numbers such as `2,9,11`.
    fn from_str(text: &str) -> Result<Classes, String> {
        let expected = || format!("expected auto, none, or classes such as 2,9 (0 to 255), found {text:?}");
        match text {
            "auto" => Ok(Classes::Auto),
            "none" => Ok(Classes::None),
            _ => {
                let classes: Result<ClassSet, _> = text.split(',').map(|class| class.trim().parse::<u8>()).collect();
                classes.map(Classes::Of).map_err(|_| expected())
            }
        }
    }
}

impl fmt::Display for Classes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Classes::Auto => f.write_str("auto"),
            Classes::None => f.write_str("none"),
            Classes::Of(classes) => {
                f.write_str(&classes.iter().map(|class| class.to_string()).collect::<Vec<_>>().join(","))
            }
        }
    }
}

impl serde::Serialize for Classes {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_set_holds_what_it_was_given_and_reads_as_it_is_written(given in prop::collection::btree_set(any::<u8>(), 1..20)) {
            let set: ClassSet = given.iter().copied().collect();
            prop_assert_eq!(set.iter().collect::<Vec<_>>(), given.into_iter().collect::<Vec<_>>());
            prop_assert_eq!(Classes::Of(set).to_string().parse(), Ok(Classes::Of(set)));
        }
    }

    #[test]
    fn classes_as_typed() {
        assert_eq!("auto".parse(), Ok(Classes::Auto));
        assert_eq!("none".parse(), Ok(Classes::None));
        assert_eq!("2, 9".parse(), Ok(Classes::Of(ClassSet::GROUND)));
        for wrong in ["", "2,", "256", "-1", "ground", "2;9"] {
            assert!(wrong.parse::<Classes>().is_err(), "{wrong}");
        }
    }
}
