//! XML of URDF and COLLADA files.

use super::files::one_line;
use roxmltree::{Document, Error, Node, ParsingOptions};

/// The most elements and texts of a file, attributes of a file and of an element, and declarations of
/// namespaces: they bound time and memory.
const MAX_NODES: u32 = 2_000_000;
const MAX_ATTRIBUTES: usize = 4_000_000;
const MAX_ATTRIBUTES_EACH: usize = 100;
const MAX_NAMESPACES: usize = 1000;
/// The most prefixes that a file may use without declaring them.
const MAX_UNDECLARED: usize = 50;

/// What the root element says, by way of `use_root`; the error says why the text is no XML.
/// A prefix that is not declared, as in old `<gazebo>` elements, stands for a namespace of its name.
pub fn read<T>(mut text: String, use_root: impl FnOnce(Node) -> T) -> Result<T, String> {
    within_bounds(&text)?;
    for _ in 0..MAX_UNDECLARED {
        let options = ParsingOptions {
            nodes_limit: MAX_NODES,
            ..ParsingOptions::default()
        };
        let prefix = match Document::parse_with_options(&text, options) {
            Ok(document) => return Ok(use_root(document.root_element())),
            Err(Error::UnknownNamespace(prefix, _)) => prefix,
            Err(Error::DtdDetected) => {
                return Err("it has a document type (DTD), which is not read".to_owned());
            }
            Err(error) => return Err(one_line(&error)),
        };
        let name_end = end_of_root_name(&text).ok_or("it has no elements")?;
        text.insert_str(name_end, &format!(" xmlns:{prefix}=\"{prefix}\""));
    }
    Err("it uses many prefixes that it does not declare".to_owned())
}

/// Where the name of the first element ends.
fn end_of_root_name(text: &str) -> Option<usize> {
    let mut at = 0;
    loop {
        at += text[at..].find('<')?;
        let rest = &text[at..];
        let end = match rest {
            _ if rest.starts_with("<!--") => "-->",
            _ if rest.starts_with("<?") => "?>",
            _ => return Some(at + rest.find(|c: char| c.is_whitespace() || "/>".contains(c))?),
        };
        at += rest.find(end)?;
    }
}

/// Fails on a text whose attributes would take too much time or memory.
fn within_bounds(text: &str) -> Result<(), String> {
    let mut total = 0;
    let mut rest = text;
    while let Some(start) = rest.find('<') {
        rest = &rest[start..];
        let special = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>")];
        if let Some((_, end)) = special.iter().find(|(start, _)| rest.starts_with(start)) {
            let length = rest.find(end).map_or(rest.len(), |at| at + end.len());
            rest = &rest[length..];
            continue;
        }
        // A tag: attributes are counted by their quoted values.
        let mut count = 0;
        loop {
            let Some(at) = rest.find(['"', '\'', '>']) else {
                rest = "";
                break;
            };
            let quote = &rest[at..=at];
            rest = &rest[at + 1..];
            if quote == ">" {
                break;
            }
            rest = rest.find(quote).map_or("", |end| &rest[end + 1..]);
            count += 1;
            if count > MAX_ATTRIBUTES_EACH {
                return Err(format!(
                    "an element has more than {MAX_ATTRIBUTES_EACH} attributes"
                ));
            }
        }
        total += count;
    }
    if total > MAX_ATTRIBUTES {
        return Err(format!("it has more than {MAX_ATTRIBUTES} attributes"));
    }
    if text.matches("xmlns").count() > MAX_NAMESPACES {
        return Err("it declares too many namespaces".to_owned());
    }
    Ok(())
}

/// The elements below `node` of that name, in the same namespace.
pub fn children<'a, 'i>(node: Node<'a, 'i>, name: &'a str) -> impl Iterator<Item = Node<'a, 'i>> {
    let namespace = node.tag_name().namespace();
    node.children().filter(move |child| {
        child.tag_name().name() == name && child.tag_name().namespace() == namespace
    })
}

/// The first of them.
pub fn child<'a, 'i>(node: Node<'a, 'i>, name: &'a str) -> Option<Node<'a, 'i>> {
    children(node, name).next()
}
