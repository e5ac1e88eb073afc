//! A folder of PNG files with a table `actions.csv`: a line for each transition with the picture before, the picture after
//! and the action.

use std::{
    fs::{self, File},
    io::BufReader,
    path::{Path, PathBuf},
};

use anyhow::{Context as _, bail, ensure};

use super::{Array, Arrays, Dtype};

/// The name of the table.
const TABLE: &str = "actions.csv";
/// The most pixels of a picture.
const MOST_PIXELS: u64 = 1 << 26;

/// A folder with its table.
pub(super) struct Pictures {
    folder: PathBuf,
    rows: Vec<Row>,
}

/// A transition.
struct Row {
    pictures: [String; 2],
    action: Vec<f64>,
}

impl Pictures {
    pub(super) fn open(folder: &Path) -> anyhow::Result<Self> {
        let path = folder.join(TABLE);
        let text = fs::read_to_string(&path).with_context(|| format!("it has no readable {TABLE}"))?;
        let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let (_, head) = lines.next().with_context(|| format!("{TABLE} is empty"))?;
        let columns: Vec<&str> = head.split(',').map(str::trim).collect();
        ensure!(
            columns.len() > 2 && columns[..2] == ["before", "after"],
            "{TABLE} begins with `{head}`, but its first line is `before,after,action_0,…`"
        );
        let row = |(number, line): (usize, &str)| {
            row(line, columns.len()).with_context(|| format!("line {} of {TABLE}", number + 1))
        };
        let rows: Vec<Row> = lines.map(row).collect::<anyhow::Result<_>>()?;
        ensure!(!rows.is_empty(), "{TABLE} has no transitions");
        Ok(Self { folder: folder.to_owned(), rows })
    }

    /// One picture of every transition.
    fn pictures(&self, which: usize) -> anyhow::Result<Array> {
        let (mut bytes, mut size) = (Vec::new(), None);
        for row in &self.rows {
            let name = &row.pictures[which];
            let (own, pixels) = picture(&self.folder.join(name)).with_context(|| format!("cannot read `{name}`"))?;
            let first = *size.get_or_insert(own);
            ensure!(own == first, "`{name}` is a picture of {own:?}, but the first one is of {first:?}");
            bytes.extend(pixels);
        }
        let [height, width, channels] = size.context("no pictures")?;
        Array::new(Dtype::U8, vec![self.rows.len(), height, width, channels], bytes)
    }
}

impl Arrays for Pictures {
    fn names(&self) -> Vec<String> {
        ["observations", "next_observations", "actions"].map(str::to_owned).to_vec()
    }

    fn read(&self, name: &str) -> anyhow::Result<Array> {
        match name {
            "observations" => self.pictures(0),
            "next_observations" => self.pictures(1),
            "actions" => {
                let bytes = self.rows.iter().flat_map(|row| &row.action).flat_map(|it| it.to_le_bytes()).collect();
                Array::new(Dtype::F64, vec![self.rows.len(), self.rows[0].action.len()], bytes)
            }
            _ => bail!("no array `{name}`: a folder of pictures has {}", self.names().join(", ")),
        }
    }
}

fn row(line: &str, columns: usize) -> anyhow::Result<Row> {
    let cells: Vec<&str> = line.split(',').map(str::trim).collect();
    ensure!(cells.len() == columns, "it has {} cells, but the first line has {columns}", cells.len());
    let number = |cell: &&str| cell.parse().with_context(|| format!("`{cell}` is no number"));
    for name in &cells[..2] {
        let is_inside = Path::new(name).components().all(|part| matches!(part, std::path::Component::Normal(_)));
        ensure!(is_inside && !name.is_empty(), "`{name}` is no file below the folder");
    }
    Ok(Row {
        pictures: [cells[0].to_owned(), cells[1].to_owned()],
        action: cells[2..].iter().map(number).collect::<anyhow::Result<_>>()?,
    })
}

/// Height, width and channels of a PNG file, and its bytes. A channel of transparency is left out.
fn picture(path: &Path) -> anyhow::Result<([usize; 3], Vec<u8>)> {
    let mut decoder = png::Decoder::new(BufReader::new(File::open(path)?));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info()?;
    let info = reader.info();
    let pixels = u64::from(info.width) * u64::from(info.height);
    ensure!(pixels <= MOST_PIXELS, "{} x {} pixels are too many", info.width, info.height);
    let mut bytes = vec![0; reader.output_buffer_size().context("it is too large")?];
    let frame = reader.next_frame(&mut bytes)?;
    bytes.truncate(frame.buffer_size());
    let (given, kept) = match frame.color_type {
        png::ColorType::Grayscale => (1, 1),
        png::ColorType::GrayscaleAlpha => (2, 1),
        png::ColorType::Rgb => (3, 3),
        png::ColorType::Rgba => (4, 3),
        png::ColorType::Indexed => bail!("its palette cannot be resolved"),
    };
    let bytes = if given == kept {
        bytes
    } else {
        bytes.chunks_exact(given).flat_map(|pixel| pixel[..kept].to_vec()).collect()
    };
    Ok(([frame.height as usize, frame.width as usize, kept], bytes))
}
