//! "Did you mean": the one rule by which the program guesses a name that was mistyped.

/// The candidate that `typed` was probably meant to be: the one at the smallest Damerau-Levenshtein distance, if at most
/// a third of the characters of `typed` differ. One wrong character is always allowed. Of equals the first counts.
pub fn nearest<'a>(typed: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let allowed = (typed.chars().count() / 3).max(1);
    candidates
        .into_iter()
        .map(|candidate| (strsim::damerau_levenshtein(typed, candidate), candidate))
        .filter(|(distance, _)| *distance <= allowed)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

/// Help for a name that does not exist: the name that was probably meant, or else the list of all names. `what` says
/// what the names are, such as `kinds`.
pub fn instead<'a>(typed: &str, what: &str, candidates: impl IntoIterator<Item = &'a str>) -> String {
    let candidates: Vec<&str> = candidates.into_iter().collect();
    match nearest(typed, candidates.iter().copied()) {
        Some(meant) => format!("did you mean `{meant}`?"),
        None if candidates.is_empty() => format!("there are no {what}"),
        None => format!("{what}: {}", candidates.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_of_the_finger_is_near_and_another_word_is_not() {
        assert_eq!(nearest("epoch", ["samples", "epochs"]), Some("epochs"));
        assert_eq!(nearest("represnet", ["represent"]), Some("represent"));
        assert_eq!(nearest("banana", ["samples", "epochs"]), None);
        assert_eq!(nearest("x", ["abc"]), None);
    }

    #[test]
    fn all_names_are_listed_where_none_is_near() {
        assert_eq!(instead("banana", "kinds", ["evaluate", "collect"]), "kinds: evaluate, collect");
        assert_eq!(instead("colect", "kinds", ["evaluate", "collect"]), "did you mean `collect`?");
        assert_eq!(instead("colect", "kinds", []), "there are no kinds");
    }
}
