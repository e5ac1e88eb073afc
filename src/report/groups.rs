//! Groups in the order in which their keys first appear.

/// The items of each key. Groups and the items of a group keep the order in which they come.
pub fn grouped<K: PartialEq, T>(items: impl IntoIterator<Item = T>, key: impl Fn(&T) -> K) -> Vec<(K, Vec<T>)> {
    let mut groups: Vec<(K, Vec<T>)> = Vec::new();
    for item in items {
        let key = key(&item);
        match groups.iter_mut().find(|(known, _)| *known == key) {
            Some((_, own)) => own.push(item),
            None => groups.push((key, vec![item])),
        }
    }
    groups
}

#[cfg(test)]
mod tests {
    #[test]
    fn groups_keep_the_order_in_which_they_first_appear() {
        let groups = super::grouped(["b1", "a1", "b2"], |word| word[..1].to_owned());
        assert_eq!(groups, [("b".to_owned(), vec!["b1", "b2"]), ("a".to_owned(), vec!["a1"])]);
    }
}
