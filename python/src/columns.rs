//! Arrays of NumPy as points: whatever type and step they have, they are read where they lie.

use std::ops::Range;

use asra_stream::{Attribute, Error, PointBuffer, PointSlice, PointSource, Precision, Result, Scalar};
use numpy::ndarray::ArrayView1;
use numpy::{PyReadonlyArray1, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

/// Declares the types that arrays may have: the array as Python lends it, and as the points' reader sees it.
macro_rules! types {
    ($($variant:ident $number:ty, $name:literal;)*) => {
        /// An array, lent for as long as it is held.
        enum Lent<'py> {
            $($variant(PyReadonlyArray1<'py, $number>),)*
        }

        /// An array of one dimension.
        #[derive(Clone, Copy)]
        enum Column<'a> {
            $($variant(ArrayView1<'a, $number>),)*
        }

        impl<'py> Lent<'py> {
            fn of(name: &str, array: &Bound<'py, PyAny>) -> PyResult<Lent<'py>> {
                $(if let Ok(array) = array.extract::<PyReadonlyArray1<'py, $number>>() {
                    return Ok(Lent::$variant(array));
                })*
                let found = match array.cast::<PyUntypedArray>() {
                    Ok(array) => format!("{} dimensions of {}", array.ndim(), array.dtype()),
                    Err(_) => array.get_type().to_string(),
                };
                Err(PyTypeError::new_err(format!("{name}: expected an array of one dimension, of numbers, found {found}")))
            }

            fn view(&self) -> Column<'_> {
                match self {
                    $(Lent::$variant(array) => Column::$variant(array.as_array()),)*
                }
            }
        }

        impl Column<'_> {
            fn scalar(&self) -> Scalar {
                match self {
                    $(Column::$variant(_) => Scalar::$variant,)*
                }
            }

            fn len(&self) -> usize {
                match self {
                    $(Column::$variant(view) => view.len(),)*
                }
            }

            fn coordinate(&self, i: usize) -> f64 {
                match self {
                    $(Column::$variant(view) => view[i] as f64,)*
                }
            }

            fn put(&self, i: usize, out: &mut Vec<u8>) {
                match self {
                    $(Column::$variant(view) => out.extend_from_slice(&view[i].to_ne_bytes()),)*
                }
            }
        }

        /// The name that NumPy has for a type.
        pub fn numpy_name(scalar: Scalar) -> &'static str {
            match scalar {
                $(Scalar::$variant => $name,)*
            }
        }
    };
}

types! {
    F32 f32, "float32";
    F64 f64, "float64";
    U8 u8, "uint8";
    U16 u16, "uint16";
    U32 u32, "uint32";
    U64 u64, "uint64";
    I8 i8, "int8";
    I16 i16, "int16";
    I32 i32, "int32";
    I64 i64, "int64";
}

/// Arrays of coordinates and attributes that Python lends.
pub struct Held<'py> {
    xyz: Vec<Lent<'py>>,
    attributes: Vec<(String, Lent<'py>)>,
}

impl<'py> Held<'py> {
    pub fn of(xyz: &[Bound<'py, PyAny>; 3], attributes: &[(String, Bound<'py, PyAny>)]) -> PyResult<Held<'py>> {
        let xyz =
            ["x", "y", "z"].iter().zip(xyz).map(|(name, array)| Lent::of(name, array)).collect::<PyResult<_>>()?;
        Ok(Held { xyz, ..Held::of_attributes(attributes)? })
    }

    pub fn of_attributes(attributes: &[(String, Bound<'py, PyAny>)]) -> PyResult<Held<'py>> {
        let lent = |(name, array): &(String, Bound<'py, PyAny>)| {
            Ok((name.clone(), Lent::of(&format!("attribute {name:?}"), array)?))
        };
        Ok(Held { xyz: Vec::new(), attributes: attributes.iter().map(lent).collect::<PyResult<_>>()? })
    }

    pub fn attribute_columns(&self) -> AttributeColumns<'_> {
        AttributeColumns(self.attributes.iter().map(|(name, lent)| (name.clone(), lent.view())).collect())
    }

    /// The points.
    ///
    /// # Errors
    /// [`Error::Usage`] if the arrays are not of one length.
    pub fn columns(&self) -> Result<Columns<'_>> {
        let xyz: Vec<Column<'_>> = self.xyz.iter().map(Lent::view).collect();
        let count = xyz[0].len();
        if xyz.iter().any(|column| column.len() != count) {
            let counts: Vec<usize> = xyz.iter().map(Column::len).collect();
            return Err(Error::Usage(format!("x, y and z: expected as many numbers in each, found {counts:?}")));
        }
        let attributes = self.attribute_columns();
        attributes.check(count)?;
        Ok(Columns { xyz: [xyz[0], xyz[1], xyz[2]], count, attributes })
    }
}

/// Arrays of attributes.
pub struct AttributeColumns<'a>(Vec<(String, Column<'a>)>);

impl AttributeColumns<'_> {
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    fn attributes(&self) -> Vec<Attribute> {
        self.0.iter().map(|(name, column)| Attribute::new(name, column.scalar())).collect()
    }

    fn check(&self, points: usize) -> Result<()> {
        match self.0.iter().find(|(_, column)| column.len() != points) {
            Some((name, column)) => {
                Err(Error::Usage(format!("attribute {name:?}: {} values for {points} points", column.len())))
            }
            None => Ok(()),
        }
    }

    fn put(&self, range: Range<usize>, out: &mut PointBuffer) {
        let mut records = Vec::new();
        for i in range {
            self.0.iter().for_each(|(_, column)| column.put(i, &mut records));
        }
        out.extend_attributes(&records);
    }
}

/// Points whose coordinates lie in three arrays.
pub struct Columns<'a> {
    xyz: [Column<'a>; 3],
    count: usize,
    attributes: AttributeColumns<'a>,
}

impl PointSource for Columns<'_> {
    fn len(&self) -> u64 {
        self.count as u64
    }

    fn precision(&self) -> Precision {
        self.xyz.iter().map(|column| column.scalar().precision()).max().unwrap_or(Precision::Double)
    }

    fn attributes(&self) -> Vec<Attribute> {
        self.attributes.attributes()
    }

    fn read(&self, range: Range<u64>, out: &mut PointBuffer) -> Result<()> {
        let range = range.start as usize..range.end as usize;
        range.clone().for_each(|i| out.push(self.xyz.map(|column| column.coordinate(i))));
        self.attributes.put(range, out);
        Ok(())
    }
}

/// Points whose coordinates lie in one array, and attributes in others.
pub struct Rows<'a> {
    points: PointSlice<'a>,
    attributes: &'a AttributeColumns<'a>,
}

impl<'a> Rows<'a> {
    /// # Errors
    /// [`Error::Usage`] if there are not as many values as points.
    pub fn new(points: PointSlice<'a>, attributes: &'a AttributeColumns<'a>) -> Result<Rows<'a>> {
        let rows = Rows { points, attributes };
        attributes.check(rows.len() as usize)?;
        Ok(rows)
    }
}

impl PointSource for Rows<'_> {
    fn len(&self) -> u64 {
        self.points.len()
    }

    fn precision(&self) -> Precision {
        self.points.precision()
    }

    fn attributes(&self) -> Vec<Attribute> {
        self.attributes.attributes()
    }

    fn read(&self, range: Range<u64>, out: &mut PointBuffer) -> Result<()> {
        self.points.read(range.clone(), out)?;
        self.attributes.put(range.start as usize..range.end as usize, out);
        Ok(())
    }
}
