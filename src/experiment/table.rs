//! Tables: tidy CSV files and what is printed in the terminal.

/// A cell of a [`Table`].
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    Text(String),
    Integer(i64),
    /// Written with six significant digits, so that files are stable and readable.
    Number(f64),
    /// Does not apply; empty in the file.
    Empty,
}

impl From<&str> for Cell {
    fn from(text: &str) -> Cell {
        Cell::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Cell {
        Cell::Text(text)
    }
}

impl From<f64> for Cell {
    fn from(number: f64) -> Cell {
        Cell::Number(number)
    }
}

impl From<f32> for Cell {
    fn from(number: f32) -> Cell {
        Cell::Number(number.into())
    }
}

impl From<usize> for Cell {
    fn from(integer: usize) -> Cell {
        Cell::Integer(integer as i64)
    }
}

impl<T: Into<Cell>> From<Option<T>> for Cell {
    fn from(value: Option<T>) -> Cell {
        value.map_or(Cell::Empty, T::into)
    }
}

impl std::fmt::Display for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Cell::Text(text) => f.write_str(text),
            Cell::Integer(integer) => write!(f, "{integer}"),
            Cell::Number(number) => f.write_str(&significant(*number, 6)),
            Cell::Empty => Ok(()),
        }
    }
}

/// `number` with `digits` significant digits and no trailing zeros, as `0.00123457`, `41.2` or
/// `1.5e-9`.
pub fn significant(number: f64, digits: usize) -> String {
    let rounded: f64 = format!("{number:.*e}", digits.max(1) - 1)
        .parse()
        .unwrap_or(number);
    if rounded == 0.0 {
        "0".to_owned() // also for -0
    } else if rounded.is_finite() && !(1e-5..1e15).contains(&rounded.abs()) {
        format!("{rounded:e}")
    } else {
        format!("{rounded}")
    }
}

/// Rows below named columns. Headers carry units: `error_deg`.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    pub columns: Vec<String>,
    pub rows: Vec<Vec<Cell>>,
}

impl Table {
    pub fn new<S: Into<String>>(columns: impl IntoIterator<Item = S>) -> Table {
        Table {
            columns: columns.into_iter().map(S::into).collect(),
            rows: Vec::new(),
        }
    }

    /// Adds a row. Panics when it has not one cell for each column.
    pub fn push(&mut self, row: impl IntoIterator<Item = Cell>) {
        let row: Vec<Cell> = row.into_iter().collect();
        assert_eq!(
            row.len(),
            self.columns.len(),
            "cells for {:?}",
            self.columns
        );
        self.rows.push(row);
    }

    /// Comma-separated values with a header line, UTF-8.
    pub fn to_csv(&self) -> Vec<u8> {
        let records = std::iter::once(self.columns.clone()).chain(
            self.rows
                .iter()
                .map(|r| r.iter().map(Cell::to_string).collect()),
        );
        let mut writer = csv::Writer::from_writer(Vec::new());
        for record in records {
            writer
                .write_record(record)
                .expect("a vector takes all rows");
        }
        writer.into_inner().expect("a vector takes all rows")
    }

    /// Aligned for a terminal, numbers to the right and with four significant digits.
    pub fn to_text(&self) -> String {
        let is_text = |column: usize| {
            let mut cells = self.rows.iter().map(|row| &row[column]);
            cells.any(|cell| matches!(cell, Cell::Text(_)))
        };
        let shown = |cell: &Cell| match cell {
            Cell::Number(number) => significant(*number, 4),
            other => other.to_string(),
        };
        let columns: Vec<Vec<String>> = (0..self.columns.len())
            .map(|column| {
                let header = self.columns[column].clone();
                let cells: Vec<String> = std::iter::once(header)
                    .chain(self.rows.iter().map(|row| shown(&row[column])))
                    .collect();
                let width = cells.iter().map(|c| c.chars().count()).max().unwrap_or(0);
                let left = is_text(column);
                let align = |cell: &String| match left {
                    true => format!("{cell:<width$}"),
                    false => format!("{cell:>width$}"),
                };
                cells.iter().map(align).collect()
            })
            .collect();
        let mut text = String::new();
        for row in 0..=self.rows.len() {
            let cells: Vec<&str> = columns.iter().map(|c| c[row].as_str()).collect();
            text.push_str(cells.join("  ").trim_end());
            text.push('\n');
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_six_significant_digits() {
        let shown = |x: f64| Cell::from(x).to_string();
        assert_eq!(shown(1.0 / 3.0), "0.333333");
        assert_eq!(shown(123_456_789.0), "123457000");
        assert_eq!(shown(-0.000_012_345_678), "-0.0000123457");
        assert_eq!(shown(2.5e-9), "2.5e-9");
        assert_eq!(shown(-0.0), "0");
        assert_eq!(shown(40.0), "40");
        assert_eq!(shown(f64::NAN), "NaN");
    }

    #[test]
    fn csv_and_text_are_golden() {
        let mut table = Table::new(["joint", "error_deg", "n"]);
        table.push(["R_SFE, a".into(), 12.345678.into(), 7_usize.into()]);
        table.push(["R_SAA".into(), Cell::Empty, 12_usize.into()]);
        assert_eq!(
            String::from_utf8(table.to_csv()).unwrap(),
            "joint,error_deg,n\n\"R_SFE, a\",12.3457,7\nR_SAA,,12\n"
        );
        assert_eq!(
            table.to_text(),
            "joint     error_deg   n\nR_SFE, a      12.35   7\nR_SAA                12\n"
        );
    }
}
