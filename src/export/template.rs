//! Text templates with placeholders such as `{{size}}`.

/// A template with all placeholders replaced.
pub(super) fn filled(template: &str, values: &[(&str, &str)]) -> String {
    let mut text = String::with_capacity(template.len());
    let mut rest = template;
    while let Some((before, (name, after))) =
        rest.split_once("{{").and_then(|(before, mark)| Some((before, mark.split_once("}}")?)))
    {
        text.push_str(before);
        let value = values.iter().find(|(known, _)| *known == name);
        text.push_str(value.expect("every mark of a template has a value").1);
        rest = after;
    }
    text + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placeholders_are_replaced_and_values_are_not() {
        let text = filled("{ {{b}}, {{a}}{{b}} }", &[("a", "{{b}}"), ("b", "2")]);
        assert_eq!(text, "{ 2, {{b}}2 }");
    }
}
