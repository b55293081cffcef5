//! The attribute that distances are carried as.

use crate::error::{Error, Result};
use crate::points::attribute::{Attribute, Schema};
use crate::points::scalar::Scalar;

/// The attribute's name.
pub(crate) const BRIDGED: &str = "bridged";

/// The schema with the attribute behind those that are there.
///
/// # Errors
/// [`Error::InvalidSetting`] if there is one of its name.
pub(crate) fn with_bridged(schema: &Schema) -> Result<Schema> {
    if schema.column(BRIDGED).is_some() {
        return Err(Error::setting(
            "bridged",
            "`bridged`: the input has an attribute of that name; `attributes` names those to carry".into(),
        ));
    }
    let own = Attribute { name: BRIDGED.to_owned(), scalar: Scalar::F32 };
    Ok(schema.clone().with(&own))
}
