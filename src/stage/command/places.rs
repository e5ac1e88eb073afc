//! The places in a word of `argv` that are filled when the program starts.

/// A part of a word.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Place<'a> {
    /// A text that stays as it is.
    Text(&'a str),
    /// `{inputs.NAME}`: the folder with the files of an input.
    Input(&'a str),
    /// `{outputs.NAME}`: the path that an output is written to.
    Output(&'a str),
    /// `{params.NAME}`: a value of `params`.
    Param(&'a str),
    /// `{seed}`: a number below 2^32 from the node's random stream.
    Seed,
    /// `{threads}`: the node's share of the cores.
    Threads,
}

/// The parts of a word. `{{` and `}}` are braces.
///
/// # Errors
/// What is wrong with the word, as a clause.
pub(super) fn places(word: &str) -> Result<Vec<Place<'_>>, String> {
    let mut parts = Vec::new();
    let mut rest = word;
    while let Some(at) = rest.find(['{', '}']) {
        let (text, brace) = rest.split_at(at);
        if !text.is_empty() {
            parts.push(Place::Text(text));
        }
        if brace.starts_with("{{") || brace.starts_with("}}") {
            parts.push(Place::Text(&brace[..1]));
            rest = &brace[2..];
            continue;
        }
        let inside = brace.strip_prefix('{').and_then(|inside| inside.split_once('}'));
        let (inside, after) = inside.ok_or("has a brace without its other half; write `{{` or `}}` for a brace")?;
        parts.push(place(inside)?);
        rest = after;
    }
    if !rest.is_empty() {
        parts.push(Place::Text(rest));
    }
    Ok(parts)
}

fn place(inside: &str) -> Result<Place<'_>, String> {
    match inside.split_once('.') {
        Some(("inputs", name)) => Ok(Place::Input(name)),
        Some(("outputs", name)) => Ok(Place::Output(name)),
        Some(("params", name)) => Ok(Place::Param(name)),
        None if inside == "seed" => Ok(Place::Seed),
        None if inside == "threads" => Ok(Place::Threads),
        _ => Err(format!(
            "has an unknown place `{{{inside}}}`; places are `{{inputs.NAME}}`, `{{outputs.NAME}}`, `{{params.NAME}}`, \
             `{{seed}}` and `{{threads}}`, and `{{{{` is a brace"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_is_cut_into_its_places() {
        use Place::{Input, Output, Param, Seed, Text, Threads};
        assert_eq!(places("--in={inputs.data}/x.npz"), Ok(vec![Text("--in="), Input("data"), Text("/x.npz")]));
        assert_eq!(places("{outputs.model}{params.a.b}"), Ok(vec![Output("model"), Param("a.b")]));
        assert_eq!(places("{seed}:{threads}"), Ok(vec![Seed, Text(":"), Threads]));
        assert_eq!(places("{{{seed}}}"), Ok(vec![Text("{"), Seed, Text("}")]));
        assert_eq!(places(""), Ok(vec![]));
        for wrong in ["{", "}", "a}b", "{inputs", "{seeds}", "{}", "{a{b}}"] {
            assert!(places(wrong).is_err(), "{wrong}");
        }
    }
}
