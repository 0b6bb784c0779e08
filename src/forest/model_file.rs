//! Trees and what their leaves say, in one file.
//!
//! Little-endian, without padding:
//!
//! | bytes | what |
//! |---|---|
//! | 8 | `armpose` and a zero byte |
//! | 4 | version of the format, now 1 |
//! | 4 | length of the header |
//! | .. | header: JSON, whatever the writer wants to know when it reads |
//! | 4 | number of values a leaf |
//! | 4 | number of trees |
//! | | then for each tree: |
//! | 4, 4 | number of nodes, number of leaves |
//! | 8 a node | feature `u16` (65535: leaf), threshold `i16`, child `u32` (see [`Node`]) |
//! | 4 a value | the leaves' values `f32`, leaf by leaf |
//! | 8 a leaf | the leaves' impurities `f64` |
//! | 32 | BLAKE3 of all that stands before |

use super::ForestError;
use super::leaves::LeafTable;
use super::tree::{Node, Tree, TreeError};
use rayon::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"armpose\0";
const VERSION: u32 = 1;
const HASH: usize = 32;

/// A model file that cannot be written or used.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    #[error("cannot write the model {path}: {cause}", path = path.display())]
    Write {
        path: PathBuf,
        cause: std::io::Error,
    },
    #[error("cannot read the model {path}: {cause}", path = path.display())]
    Read {
        path: PathBuf,
        cause: std::io::Error,
    },
    #[error("{path} is not a usable model: {fault}", path = path.display())]
    Unusable { path: PathBuf, fault: Fault },
}

/// What is wrong with the content.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    #[error("it does not begin as a model of armpose does")]
    Foreign,
    #[error("its format is version {0}, this program reads version {VERSION}; train it again")]
    Version(u32),
    #[error("it is cut off or was altered; copy or train it again")]
    Altered,
    #[error("its parts do not fit together: {0}")]
    Inconsistent(#[from] ForestError),
    #[error("{0} bytes follow after its end")]
    Trailing(usize),
    #[error("its header is for something else: {0}")]
    Header(#[from] serde_json::Error),
    #[error("tree {tree}: {cause}")]
    Tree { tree: usize, cause: TreeError },
}

/// Writes a model at one stroke: whoever reads `path` sees the old file or the new one.
pub fn write<H: Serialize>(
    path: &Path,
    header: &H,
    trees: &[Tree],
    leaves: &[LeafTable],
) -> Result<(), ModelError> {
    let failed = |cause: std::io::Error| ModelError::Write {
        path: path.to_owned(),
        cause,
    };
    let bytes = encode(header, trees, leaves).map_err(|e| failed(e.into()))?;
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}.tmp", std::process::id()));
    let unfinished = path.with_file_name(name);
    let written = std::fs::write(&unfinished, bytes)
        .and_then(|()| std::fs::rename(&unfinished, path))
        .map_err(failed);
    if written.is_err() {
        // Nothing half-written stays behind; that it could not be removed matters to no one.
        let _ = std::fs::remove_file(&unfinished);
    }
    written
}

/// Reads a model and checks all of it. `features` says of a header how many features the trees may
/// ask for.
pub fn read<H: DeserializeOwned>(
    path: &Path,
    features: impl Fn(&H) -> usize,
) -> Result<(H, Vec<Tree>, Vec<LeafTable>), ModelError> {
    let bytes = std::fs::read(path).map_err(|cause| ModelError::Read {
        path: path.to_owned(),
        cause,
    })?;
    decode(&bytes, features).map_err(|fault| ModelError::Unusable {
        path: path.to_owned(),
        fault,
    })
}

fn encode<H: Serialize>(
    header: &H,
    trees: &[Tree],
    leaves: &[LeafTable],
) -> Result<Vec<u8>, serde_json::Error> {
    let header = serde_json::to_vec(header)?;
    let mut bytes = Vec::new();
    bytes.extend(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    let number = |bytes: &mut Vec<u8>, n: usize| bytes.extend((n as u32).to_le_bytes());
    number(&mut bytes, header.len());
    bytes.extend(header);
    number(&mut bytes, leaves.first().map_or(0, LeafTable::width));
    number(&mut bytes, trees.len());
    for (tree, leaves) in trees.iter().zip(leaves) {
        number(&mut bytes, tree.nodes().len());
        number(&mut bytes, leaves.leaves());
        for node in tree.nodes() {
            bytes.extend(node.feature.to_le_bytes());
            bytes.extend(node.threshold.to_le_bytes());
            bytes.extend(node.child.to_le_bytes());
        }
        bytes.extend(leaves.values().iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(leaves.impurities().iter().flat_map(|v| v.to_le_bytes()));
    }
    let hash = blake3::hash(&bytes);
    bytes.extend(hash.as_bytes());
    Ok(bytes)
}

fn decode<H: DeserializeOwned>(
    bytes: &[u8],
    features: impl Fn(&H) -> usize,
) -> Result<(H, Vec<Tree>, Vec<LeafTable>), Fault> {
    let mut start = Cursor(bytes);
    if start.take(MAGIC.len()).map_err(|_| Fault::Foreign)? != MAGIC {
        return Err(Fault::Foreign);
    }
    let version = start.number()?;
    if version != VERSION {
        return Err(Fault::Version(version));
    }
    let (content, hash) = bytes.split_last_chunk::<HASH>().ok_or(Fault::Altered)?;
    if blake3::hash(content).as_bytes() != hash {
        return Err(Fault::Altered);
    }
    // From here on only who wrote the file can be wrong.
    let mut content = Cursor(content.get(MAGIC.len() + 4..).ok_or(Fault::Altered)?);
    let length = content.number()? as usize;
    let header = serde_json::from_slice(content.take(length)?)?;
    let features = features(&header);
    let width = content.number()? as usize;
    let count = content.number()?;
    let parts = (0..count)
        .map(|_| Part::take(&mut content, width))
        .collect::<Result<Vec<_>, _>>()?;
    if !content.0.is_empty() {
        return Err(Fault::Trailing(content.0.len()));
    }
    // Of several faults the first, whatever the number of threads.
    let read: Vec<_> = parts
        .par_iter()
        .enumerate()
        .map(|(tree, part)| part.read(tree, width, features))
        .collect();
    let read = read.into_iter().collect::<Result<Vec<_>, Fault>>()?;
    let (trees, tables) = read.into_iter().unzip();
    Ok((header, trees, tables))
}

/// Where the content of one tree stands.
struct Part<'a> {
    nodes: &'a [u8],
    values: &'a [u8],
    impurities: &'a [u8],
}

impl<'a> Part<'a> {
    fn take(content: &mut Cursor<'a>, width: usize) -> Result<Self, Fault> {
        let nodes = content.number()? as usize;
        let leaves = content.number()? as usize;
        let bytes = |count: usize, size: usize| count.checked_mul(size).ok_or(Fault::Altered);
        Ok(Self {
            nodes: content.take(bytes(nodes, 8)?)?,
            values: content.take(bytes(bytes(leaves, width)?, 4)?)?,
            impurities: content.take(bytes(leaves, 8)?)?,
        })
    }

    fn read(&self, tree: usize, width: usize, features: usize) -> Result<(Tree, LeafTable), Fault> {
        let nodes = numbers(self.nodes, |[f0, f1, t0, t1, c0, c1, c2, c3]| Node {
            feature: u16::from_le_bytes([f0, f1]),
            threshold: i16::from_le_bytes([t0, t1]),
            child: u32::from_le_bytes([c0, c1, c2, c3]),
        });
        let nodes = Tree::new(nodes, features).map_err(|cause| Fault::Tree { tree, cause })?;
        let values = numbers(self.values, f32::from_le_bytes);
        let table = LeafTable::new(width, values, numbers(self.impurities, f64::from_le_bytes))?;
        if table.leaves() != nodes.leaves() {
            return Err(Fault::Inconsistent(ForestError::Size {
                what: "rows of a table of leaves",
                got: table.leaves(),
                expected: nodes.leaves(),
            }));
        }
        Ok((nodes, table))
    }
}

/// The numbers that `bytes` hold, N bytes each.
fn numbers<T, const N: usize>(bytes: &[u8], read: impl Fn([u8; N]) -> T) -> Vec<T> {
    let (chunks, _) = bytes.as_chunks();
    chunks.iter().map(|&chunk| read(chunk)).collect()
}

/// What has not been read yet.
struct Cursor<'a>(&'a [u8]);

impl<'a> Cursor<'a> {
    fn take(&mut self, length: usize) -> Result<&'a [u8], Fault> {
        let (taken, rest) = self.0.split_at_checked(length).ok_or(Fault::Altered)?;
        self.0 = rest;
        Ok(taken)
    }

    fn number(&mut self) -> Result<u32, Fault> {
        let bytes = self.0.split_first_chunk().ok_or(Fault::Altered)?;
        self.0 = bytes.1;
        Ok(u32::from_le_bytes(*bytes.0))
    }
}
