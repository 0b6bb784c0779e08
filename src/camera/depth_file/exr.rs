//! Depth images as OpenEXR.

use super::{Grid, Kind, Size};
use exr::block::reader::Reader;
use exr::image::{AnyChannel, FlatSamples};
use exr::prelude::{ReadChannels, ReadLayers, read};
use std::fs::File;
use std::io::BufReader;

/// The channel that holds depth is called so; the first that is there is taken. `V` is Blender's, `R` that
/// of programs that write depth as grey colours.
const CHANNELS: [&str; 5] = ["z", "depth", "v", "y", "r"];

/// Compressed files are read block by block; no block may take more than this.
const LARGEST_BLOCK: usize = 1 << 28;

/// Reads the only layer of a file.
pub(super) fn read_exr(file: File, size: Size) -> Result<Grid, String> {
    let failed = |e: exr::error::Error| e.to_string();
    let reader = Reader::read_from_buffered(BufReader::new(file), false).map_err(failed)?;
    let [header] = reader.headers() else {
        return Err("it holds several layers, but depth must be alone".to_owned());
    };
    let layer = header.layer_size;
    let [width, height] = size.check(layer.x() as u64, layer.y() as u64)?;
    let shown = header.shared_attributes.display_window;
    if (shown.size, shown.position) != (layer, header.own_attributes.layer_position) {
        return Err("it holds only a part of its image".to_owned());
    }
    if header.max_block_byte_size() > LARGEST_BLOCK {
        return Err("its blocks are too large".to_owned());
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_chunks(reader)
        .map_err(failed)?;
    let channels = image.layer_data.channel_data.list;
    let called = |name: &str| {
        let is_it = |channel: &&AnyChannel<FlatSamples>| {
            let channel = channel.name.to_string().to_lowercase();
            channel.rsplit('.').next() == Some(name)
        };
        channels.iter().find(is_it)
    };
    let channel = match &channels[..] {
        [only] => only,
        _ => CHANNELS.into_iter().find_map(called).ok_or_else(|| {
            let names: Vec<String> = channels
                .iter()
                .take(8)
                .map(|c| c.name.to_string())
                .collect();
            format!(
                "none of its channels {} is called Z or depth",
                names.join(", ")
            )
        })?,
    };
    let colours = called("g").into_iter().chain(called("b"));
    let (kind, values) = numbers(&channel.sample_data);
    if channel.name.to_string().to_lowercase().ends_with('r')
        && !colours
            .map(|c| numbers(&c.sample_data).1)
            .all(|c| same(&c, &values))
    {
        return Err("it holds colours, not depth".to_owned());
    }
    match values.len() == width * height {
        true => Ok(Grid {
            width,
            height,
            kind,
            values,
        }),
        false => Err("its depth has not a value for each pixel".to_owned()),
    }
}

/// NaN included.
fn same(a: &[f64], b: &[f64]) -> bool {
    a.iter()
        .map(|x| x.to_bits())
        .eq(b.iter().map(|x| x.to_bits()))
}

fn numbers(samples: &FlatSamples) -> (Kind, Vec<f64>) {
    match samples {
        FlatSamples::F16(v) => (Kind::Float, v.iter().map(|x| x.to_f64()).collect()),
        FlatSamples::F32(v) => (Kind::Float, v.iter().map(|&x| x.into()).collect()),
        FlatSamples::U32(v) => (Kind::Integer32, v.iter().map(|&x| x.into()).collect()),
    }
}
