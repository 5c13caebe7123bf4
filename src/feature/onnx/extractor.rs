//! How do cells of a network become keypoints with descriptors?

use std::path::PathBuf;

use super::cells::Cells;
use super::input::planes;
use super::network::Network;
use super::projection::Projection;
use super::{Models, OnnxConfig};
use crate::feature::selection::{check_mask, is_shown};
use crate::feature::{Extractor, ExtractorConfig, Features, GrayImage, GrayView, Keypoint};
use fremen::error::{Error, Result};

/// Grey levels that a picture differs by, at least; a network sees something in noise, too.
const MIN_LEVELS: u8 = 8;

/// The strongest cells of a layer with hashed channels.
pub struct OnnxExtractor {
    config: OnnxConfig,
    network: Network,
    projection: Projection,
    /// The model's file, for errors.
    path: PathBuf,
}

impl OnnxExtractor {
    /// Finds the model, reads it and runs it once, so that a network that cannot be used fails here
    /// and not at the first image.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Config`](fremen::ErrorKind::Config) for values out of range and a layer that is
    /// not there or no grid of cells, with those that are; those of [`Models::find`];
    /// [`ErrorKind::Shape`](fremen::ErrorKind::Shape) for another input than one image;
    /// [`ErrorKind::Format`](fremen::ErrorKind::Format) for a file that is no network or gives what
    /// is no number.
    pub fn new(config: OnnxConfig, models: &Models) -> Result<Self> {
        config.check()?;
        let model = models.find(config.model())?;
        let config = config.with_model(Some(model.digest));
        let network = Network::load(&model, &config)?;
        let [num_channels, ..] = network.output_shape();
        let extractor = Self {
            projection: Projection::new(num_channels, config.num_bits()),
            config,
            network,
            path: model.path,
        };
        let ramp = (0..=255).collect();
        extractor.cells(GrayImage::new(16, 16, ramp)?.view())?;
        Ok(extractor)
    }

    /// What the network says of an image that has pixels.
    fn cells(&self, image: GrayView<'_>) -> Result<Cells> {
        let (width, height) = self.config.input_size();
        let size = (width as usize, height as usize);
        let planes = planes(image, size, self.config.normalization());
        let values = self
            .network
            .run(&planes)
            .map_err(|error| self.named(error))?;
        let [_, rows, columns] = self.network.output_shape();
        Ok(Cells::new(columns, rows, values))
    }

    fn named(&self, error: Error) -> Error {
        let place = format!("layer `{}`", self.config.layer());
        error.with_path(&self.path).with_place(place)
    }
}

impl std::fmt::Debug for OnnxExtractor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OnnxExtractor")
            .field("config", &self.config)
            .field("path", &self.path)
            .finish_non_exhaustive()
    }
}

impl Extractor for OnnxExtractor {
    fn id(&self) -> String {
        ExtractorConfig::Onnx(self.config.clone()).id()
    }

    fn extract_into(
        &self,
        image: GrayView<'_>,
        mask: Option<&GrayImage>,
        features: &mut Features,
    ) -> Result<()> {
        check_mask(image, mask)?;
        features.truncate(0);
        let [_, rows, columns] = self.network.output_shape();
        let levels = image.gray_range(mask).map_or(0, |(low, high)| high - low);
        if image.width() < columns || image.height() < rows || levels < MIN_LEVELS {
            return Ok(());
        }
        let mut cells = self.cells(image)?;
        let across_px = image.width() as f64 / columns as f64;
        let down_px = image.height() as f64 / rows as f64;
        let keypoint = |cell: usize, response: f32| Keypoint {
            x: (((cell % columns) as f64 + 0.5) * across_px - 0.5) as f32,
            y: (((cell / columns) as f64 + 0.5) * down_px - 0.5) as f32,
            size: across_px.max(down_px) as f32,
            response,
        };
        let is_shown: Vec<bool> = (0..columns * rows)
            .map(|cell| is_shown(&keypoint(cell, 0.0), mask))
            .collect();

        cells.smooth(self.config.smooth_cells());
        cells.standardize(&is_shown);
        let strengths = cells.strengths();
        let strongest = cells.strongest(&strengths, &is_shown, self.config.suppress_cells());
        let mut sums = Vec::new();
        for cell in strongest.into_iter().take(self.config.num_features()) {
            let descriptor = self.projection.describe(cells.channels(cell), &mut sums);
            features.push(keypoint(cell, strengths[cell]), descriptor);
        }
        Ok(())
    }
}
