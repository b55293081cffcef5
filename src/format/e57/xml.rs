//! As much XML as E57 files have: elements, attributes, text. No document types, no namespaces, and nothing that grows faster than the text.

/// The longest text read; that of a thousand scans is shorter.
pub const MAX_TEXT: u64 = 4 << 20;
/// The most elements, the deepest nesting, the most attributes of an element.
const MOST: (usize, usize, usize) = (100_000, 32, 32);

/// An element: what is in it comes behind it.
#[derive(Debug, Default)]
struct Node {
    name: String,
    attributes: Vec<(String, String)>,
    text: String,
    parent: usize,
}

/// The elements of a document, in its order; the first one stands for the document.
#[derive(Debug)]
pub struct Tree {
    nodes: Vec<Node>,
}

/// An element of a tree.
#[derive(Debug, Clone, Copy)]
pub struct Element<'a> {
    tree: &'a Tree,
    index: usize,
}

impl Tree {
    /// Reads a document.
    ///
    /// # Errors
    /// What was found in it, and at which byte.
    pub fn parse(document: &str) -> Result<Tree, (usize, String)> {
        let mut tree = Tree { nodes: vec![Node::default()] };
        let mut open = vec![0];
        let mut at = 0;
        while let Some(tag) = document[at..].find('<').map(|found| at + found) {
            let here = *open.last().expect("the document stays open");
            tree.nodes[here].text.push_str(&plain(&document[at..tag]));
            let rest = &document[tag..];
            let past = |opening: &str, closing: &str| {
                let end = rest[opening.len()..].find(closing).ok_or((tag, format!("no {closing}")))?;
                Ok::<_, (usize, String)>((
                    &rest[opening.len()..opening.len() + end],
                    tag + opening.len() + end + closing.len(),
                ))
            };
            if rest.starts_with("<!--") {
                (_, at) = past("<!--", "-->")?;
            } else if rest.starts_with("<![CDATA[") {
                let text;
                (text, at) = past("<![CDATA[", "]]>")?;
                tree.nodes[here].text.push_str(text);
            } else if rest.starts_with("<?") {
                (_, at) = past("<?", "?>")?;
            } else if rest.starts_with("<!") {
                return Err((tag, "a declaration".to_string()));
            } else if rest.starts_with("</") {
                let name;
                (name, at) = past("</", ">")?;
                if open.len() == 1 || name.trim() != tree.nodes[here].name {
                    return Err((tag, format!("the end of {name:?} within {:?}", tree.nodes[here].name)));
                }
                open.pop();
            } else {
                let (mut node, length, empty) = element(rest).map_err(|found| (tag, found))?;
                at = tag + length;
                node.parent = here;
                let index = tree.nodes.len();
                tree.nodes.push(node);
                if !empty {
                    open.push(index);
                }
                if tree.nodes.len() > MOST.0 || open.len() > MOST.1 {
                    return Err((tag, format!("more than {} elements, or {} in each other", MOST.0, MOST.1)));
                }
            }
        }
        if open.len() > 1 {
            return Err((document.len(), format!("the end within {:?}", tree.nodes[open[1]].name)));
        }
        Ok(tree)
    }

    /// The document.
    pub fn root(&self) -> Element<'_> {
        Element { tree: self, index: 0 }
    }
}

impl<'a> Element<'a> {
    /// The elements directly in it.
    pub fn children(self) -> impl Iterator<Item = Element<'a>> {
        let nodes = &self.tree.nodes;
        // Elements behind this one belong to it up to the first that belongs to an earlier one.
        let inner = (self.index + 1..nodes.len()).take_while(move |&i| nodes[i].parent >= self.index);
        inner.filter(move |&i| nodes[i].parent == self.index).map(move |index| Element { index, ..self })
    }

    /// The first element of this name that is directly in it.
    pub fn child(self, name: &str) -> Option<Element<'a>> {
        self.children().find(|child| child.name() == name)
    }

    /// Its name.
    pub fn name(self) -> &'a str {
        &self.tree.nodes[self.index].name
    }

    /// The value of an attribute.
    pub fn attribute(self, name: &str) -> Option<&'a str> {
        let attributes = &self.tree.nodes[self.index].attributes;
        attributes.iter().find(|(own, _)| own == name).map(|(_, value)| value.as_str())
    }

    /// The text in it, without blanks round it.
    pub fn text(self) -> &'a str {
        self.tree.nodes[self.index].text.trim()
    }
}

/// The element whose tag `text` begins with, the tag's length, and whether it is empty.
fn element(text: &str) -> Result<(Node, usize, bool), String> {
    let cut = || "a tag that does not end".to_string();
    let mut node = Node::default();
    let end = text.find(|c: char| c.is_whitespace() || c == '>' || c == '/').ok_or_else(cut)?;
    node.name = text[1..end].to_string();
    let mut at = end;
    loop {
        at += text[at..].find(|c: char| !c.is_whitespace()).ok_or_else(cut)?;
        let rest = &text[at..];
        if rest.starts_with('>') {
            return Ok((node, at + 1, false));
        }
        if rest.starts_with("/>") {
            return Ok((node, at + 2, true));
        }
        let equals = rest.find(['=', '<', '>']).filter(|&at| rest[at..].starts_with('=')).ok_or_else(cut)?;
        let quoted = rest[equals + 1..].trim_start();
        let quote = quoted.chars().next().filter(|c| matches!(c, '"' | '\'')).ok_or("an attribute without quotes")?;
        let length = quoted[1..].find(quote).ok_or_else(cut)?;
        node.attributes.push((rest[..equals].trim().to_string(), plain(&quoted[1..1 + length])));
        if node.attributes.len() > MOST.2 {
            return Err(format!("more than {} attributes", MOST.2));
        }
        at = text.len() - quoted.len() + 1 + length + 1;
    }
}

/// Text with its entities replaced.
fn plain(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find('&') {
        out.push_str(&rest[..at]);
        rest = &rest[at..];
        let known = [("&lt;", "<"), ("&gt;", ">"), ("&amp;", "&"), ("&quot;", "\""), ("&apos;", "'")];
        let (entity, meant) = known.into_iter().find(|(entity, _)| rest.starts_with(entity)).unwrap_or(("&", "&"));
        out.push_str(meant);
        rest = &rest[entity.len()..];
    }
    out.push_str(rest);
    out
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn elements_attributes_and_texts_are_found() {
        let text = "<?xml version=\"1.0\"?><!-- a < b --><r a = 'x>y' b=\"&lt;1\"><c/> t&amp;u <c>2</c><d><c>3</c></d><e><![CDATA[<raw>]]></e></r>";
        let tree = Tree::parse(text).unwrap();
        let root = tree.root().child("r").unwrap();
        assert_eq!((root.attribute("a"), root.attribute("b"), root.attribute("c")), (Some("x>y"), Some("<1"), None));
        assert_eq!(root.text(), "t&u");
        assert_eq!(
            root.children().map(|c| (c.name(), c.text())).collect::<Vec<_>>(),
            [("c", ""), ("c", "2"), ("d", ""), ("e", "<raw>")]
        );
        assert_eq!(root.child("d").unwrap().children().count(), 1);
        for end in 1..text.len() - 1 {
            drop(Tree::parse(&text[..end]));
        }
        for bad in ["<a>", "</a>", "<a></b>", "<a b=c/>", "<!DOCTYPE a []><a/>", "<a", "<a b='", &"<a>".repeat(40)] {
            assert!(Tree::parse(bad).is_err(), "{bad}");
        }
    }

    proptest! {
        #[test]
        fn no_text_makes_it_panic(text in "[<>/='\"a &;!\\[\\]?-]{0,60}", other in "\\PC{0,60}") {
            for text in [text, other] {
                if let Ok(tree) = Tree::parse(&text) {
                    let _ = tree.root().children().map(|c| c.children().count() + c.text().len()).sum::<usize>();
                }
            }
        }
    }
}
