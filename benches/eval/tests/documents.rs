//! Checks the options and values of `svbrdf-eval` commands in the documents.

#[path = "../../../tests/common/commands.rs"]
mod commands;

use std::path::Path;

use commands::{commands, documents, understood};

/// The arguments of a command that runs `svbrdf-eval`, by name or by cargo.
fn arguments<'a>(words: &'a [&'a str]) -> Option<&'a [&'a str]> {
    match words {
        ["svbrdf-eval", arguments @ ..] => Some(arguments),
        ["cargo", "run", ..] if words.contains(&"svbrdf-eval") => {
            let end = words.iter().position(|word| *word == "--")?;
            Some(&words[end + 1..])
        }
        _ => None,
    }
}

/// The fault of a command; `None` also for commands of other programs.
fn fault(command: &str) -> Option<String> {
    let words: Vec<&str> = command.split_whitespace().collect();
    understood(env!("CARGO_BIN_EXE_svbrdf-eval"), arguments(&words)?).err()
}

#[test]
fn commands_of_the_documents_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let documents = documents(&root);
    let all = documents
        .iter()
        .flat_map(|(document, commands)| commands.iter().map(move |command| (document, command)));
    let ours: Vec<_> = all.filter(|(_, command)| command.contains("svbrdf-eval ")).collect();
    for (document, command) in &ours {
        assert_eq!(fault(command), None, "{document}: `{command}`");
    }
    assert!(ours.len() >= 8, "{} commands", ours.len());
}

#[test]
fn wrong_commands_are_seen() {
    let block = "```sh\ncargo run --release --bin svbrdf-eval -- photoz DIR  # why\n```\n";
    assert!(fault(&commands(block)[0]).unwrap().contains("photoz"));
    assert!(fault("svbrdf-eval hashes --materialz DIR").unwrap().contains("--materialz"));
    assert_eq!(fault("svbrdf-eval photos DIR..."), None);
}
