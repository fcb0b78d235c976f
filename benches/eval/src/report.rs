//! Means over all crops, as a Markdown table.

use svbrdf::comparison::Differences;

/// Sums by row, in the order of first appearance.
#[derive(Default)]
pub struct Report {
    rows: Vec<Row>,
    verbose: bool,
}

struct Row {
    name: String,
    count: usize,
    /// normal, diffuse, specular, roughness, render, squared render
    sums: [f64; 6],
}

impl Report {
    pub fn new(verbose: bool) -> Self {
        Self { rows: Vec::new(), verbose }
    }

    /// Adds the errors of one crop to a row.
    pub fn add(&mut self, crop: &str, row: &str, d: &Differences) {
        if self.verbose {
            println!(
                "{crop:<50} {row:<28} render {:.4} normal {:.4} diffuse {:.4} specular {:.4} roughness {:.4}",
                d.render, d.normal, d.diffuse, d.specular, d.roughness
            );
        }
        let values = [d.normal, d.diffuse, d.specular, d.roughness, d.render, d.render.powi(2)];
        let index = self.rows.iter().position(|r| r.name == row).unwrap_or_else(|| {
            self.rows.push(Row { name: row.to_owned(), count: 0, sums: [0.0; 6] });
            self.rows.len() - 1
        });
        let row = &mut self.rows[index];
        row.count += 1;
        row.sums.iter_mut().zip(values).for_each(|(s, v)| *s += v);
    }

    /// Prints the table. With `clean`, the last column is the mean square of the renderings
    /// relative to that row's.
    pub fn print(&self, clean: Option<&str>) {
        let clean = clean.and_then(|name| self.rows.iter().find(|r| r.name == name));
        let ratio = if clean.is_some() { " ratio |" } else { "" };
        println!("| | render | mean square | normal | diffuse | specular | roughness |{ratio}");
        println!("|---|---|---|---|---|---|---|{}", if clean.is_some() { "---|" } else { "" });
        for row in &self.rows {
            let [normal, diffuse, specular, roughness, render, square] =
                row.sums.map(|s| s / row.count as f64);
            print!(
                "| {} | {render:.4} | {square:.6} | {normal:.4} | {diffuse:.4} | {specular:.4} | {roughness:.4} |",
                row.name
            );
            if let Some(clean) = clean {
                print!(" {:.2} |", square / (clean.sums[5] / clean.count as f64));
            }
            println!();
        }
        println!("\n{} crops", self.rows.first().map_or(0, |r| r.count));
    }
}
