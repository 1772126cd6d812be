//! Names of the features.

use super::extractor::MultiBand;
use super::moments::LAG;
use super::quantiles::PROBABILITIES;
#[cfg(doc)]
use crate::error::Error;
use crate::error::Result;
use crate::features::NAME_BYTES;
use crate::memory::{reserved, room};
use crate::wrench::axis_name;

impl MultiBand {
    /// Names of the features, in order: `b0_coupling_fx_fx ... b0_q02_fx ... b0_envelope_fx_0 ... spectrum_fx_00`.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub fn names(&self) -> Result<Vec<String>> {
        let n_bands = self.n_bands();
        let axes: Vec<_> = (0..self.n_axes()).map(|axis| axis_name(axis, self.n_axes())).collect();
        room(self.n_features().saturating_mul(NAME_BYTES))?;
        let mut names = reserved(self.n_features())?;
        if let Some(coupling) = &self.coupling {
            let whole: Vec<_> = [String::new(), format!("_lag{LAG}")]
                .iter()
                .flat_map(|lag| axes.iter().map(move |axis| format!("{axis}{lag}")))
                .collect();
            for band in 0..coupling.n_bands() {
                for (i, one) in whole.iter().enumerate() {
                    names.extend(whole[i..].iter().map(|other| format!("b{band}_coupling_{one}_{other}")));
                }
            }
        }
        let each = |names: &mut Vec<String>, name: &dyn Fn(usize, &str, &mut Vec<String>)| {
            for band in 0..n_bands {
                for axis in &axes {
                    name(band, axis, names);
                }
            }
        };
        if self.quantiles.is_some() {
            each(&mut names, &|band, axis, names| {
                names.extend(PROBABILITIES.map(|p| format!("b{band}_q{:02.0}_{axis}", 100.0 * p)));
                names.push(format!("b{band}_logrms_{axis}"));
            });
        }
        if let Some(envelope) = &self.envelope {
            let stretches = envelope.n_features() / (n_bands * axes.len());
            each(&mut names, &|band, axis, names| {
                names.extend((0..stretches).map(|stretch| format!("b{band}_envelope_{axis}_{stretch}")));
            });
        }
        let bins = self.spectrum.as_ref().map_or(0, |spectrum| spectrum.n_features() / axes.len());
        let stretches = self.level.as_ref().map_or(0, super::level::Level::stretches);
        for (what, n) in [("spectrum", bins), ("level", stretches)] {
            for axis in &axes {
                names.extend((0..n).map(|i| format!("{what}_{axis}_{i:02}")));
            }
        }
        Ok(names)
    }
}
