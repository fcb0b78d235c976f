//! Photographs that arrive while the fit runs.

use std::path::PathBuf;

use svbrdf::files::{LeftOut, Metadata};

use super::input::{self, Input, LOOK};
use super::output::Output;
use super::photographs::Fit;
use crate::failure::Result;
use crate::interrupt::Interrupt;
use crate::pictures::Folder;

/// Takes photographs until interrupted, and writes everything after each.
pub fn run(input: &mut Input, fit: &mut Fit, output: &Output, interrupt: &Interrupt) -> Result<()> {
    let mut written = (0, 0);
    loop {
        refuse_unreadable(input, fit);
        let now = (fit.fitted(), fit.replaced());
        if now.0 > 0 && now != written && !interrupt.is_set() {
            output.write(input, fit)?;
            written = now;
            let (out, fitted) = (output.arguments.out.display(), now.0);
            fit.progress.say(&format!(
                "{out} holds the maps so far, photos in the fit: {fitted}; waiting for more, Ctrl-C ends"
            ));
        }
        let arrived = loop {
            if interrupt.is_set() {
                return Ok(());
            }
            std::thread::sleep(LOOK);
            let arrived = arrived(input)?.sorted_out(&output.arguments.out);
            input::tell(&arrived.foreign, &[], &mut fit.progress);
            leave_out(input, arrived.foreign);
            if !arrived.pictures.is_empty() {
                break arrived.pictures;
            }
        };
        let arrived = arrived.into_iter().filter(|path| fit.make_way(path)).collect();
        add(input, fit, arrived);
        fit.run()?;
    }
}

fn arrived(input: &mut Input) -> Result<Folder> {
    let watch = input.photographs.as_mut().and_then(|p| p.watch.as_mut());
    watch.map_or_else(|| Ok(Folder::default()), |watch| watch.arrived())
}

fn leave_out(input: &mut Input, foreign: Vec<LeftOut>) {
    if let Some(photographs) = input.photographs.as_mut() {
        photographs.choice.left_out.extend(foreign);
    }
}

/// Marks unreadable files to be read again: they may be incomplete.
fn refuse_unreadable(input: &mut Input, fit: &Fit) {
    let Some(watch) = input.photographs.as_mut().and_then(|p| p.watch.as_mut()) else { return };
    for file in fit.photos.iter().filter(|file| fit.is_unreadable(&file.path)) {
        watch.refuse(&file.path);
    }
}

fn add(input: &mut Input, fit: &mut Fit, arrived: Vec<PathBuf>) {
    let Some(photographs) = input.photographs.as_mut() else { return };
    let choice = &mut photographs.choice;
    choice.take_back(&arrived);
    let (remarks, left_out, chosen) =
        (choice.remarks.len(), choice.left_out.len(), choice.chosen.len());
    choice.add(arrived.into_iter().map(|path| (Metadata::read(&path), path)).collect());
    fit.photos.extend(choice.chosen[chosen..].iter().map(input::photo_file));
    input::tell(&choice.left_out[left_out..], &choice.remarks[remarks..], &mut fit.progress);
}
