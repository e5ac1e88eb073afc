//! Suffixes that tell apart what would otherwise have the same name.

/// One suffix for each item: empty, or `, word` for each part in which it differs from an item of the same name.
///
/// `parts` are tried in order, and each part is added only where names with their suffixes are still equal.
pub(super) fn suffixes<T, N: PartialEq>(
    items: &[T],
    name: impl Fn(&T) -> N,
    parts: &[&dyn Fn(&T) -> String],
) -> Vec<String> {
    let names: Vec<N> = items.iter().map(name).collect();
    let mut suffixes = vec![String::new(); items.len()];
    for part in parts {
        let words: Vec<String> = items.iter().map(part).collect();
        let before = suffixes.clone();
        for (at, suffix) in suffixes.iter_mut().enumerate() {
            let is_rival = |other: usize| names[other] == names[at] && before[other] == before[at];
            if !words[at].is_empty() && (0..items.len()).any(|other| is_rival(other) && words[other] != words[at]) {
                suffix.push_str(&format!(", {}", words[at]));
            }
        }
    }
    suffixes
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_part_is_added_only_where_names_are_still_equal() {
        type Item = (&'static str, &'static str, &'static str);
        let items: [Item; 4] = [("a", "x", "1"), ("a", "x", "2"), ("a", "y", "3"), ("b", "z", "4")];
        let parts: [&dyn Fn(&Item) -> String; 2] = [&|it| it.1.to_owned(), &|it| it.2.to_owned()];
        assert_eq!(super::suffixes(&items, |it| it.0, &parts), [", x, 1", ", x, 2", ", y", ""]);
    }
}
