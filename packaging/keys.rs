//! Reads the tables and keys of config/headingd.toml, with what its comments say of them.

/// A table of the file.
#[derive(Debug)]
pub struct Table {
    pub name: String,
    pub about: String,
    pub keys: Vec<Key>,
}

/// A key of it.
#[derive(Debug)]
pub struct Key {
    pub name: String,
    pub about: String,
    /// As written; `None` for a key that stands there as a comment.
    pub default: Option<String>,
}

/// All tables, in order. A comment belongs to what stands right below it.
pub fn read(text: &str) -> Result<Vec<Table>, String> {
    let mut tables: Vec<Table> = Vec::new();
    let mut about = String::new();
    for (index, line) in text.lines().enumerate() {
        let fault = |what: &str| format!("line {}: {what}: {line}", index + 1);
        if line.is_empty() {
            about.clear();
        } else if let Some(comment) = line.strip_prefix("# ") {
            if !about.is_empty() {
                about.push(' ');
            }
            about.push_str(comment);
        } else if let Some(name) = line
            .strip_prefix('[')
            .and_then(|rest| rest.strip_suffix(']'))
        {
            tables.push(Table {
                name: name.to_owned(),
                about: std::mem::take(&mut about),
                keys: Vec::new(),
            });
        } else {
            let (name, value) = line.split_once(" = ").ok_or_else(|| fault("no key"))?;
            let table = tables.last_mut().ok_or_else(|| fault("in no table"))?;
            let left_out = name.strip_prefix('#');
            table.keys.push(Key {
                name: left_out.unwrap_or(name).to_owned(),
                about: std::mem::take(&mut about),
                default: left_out.is_none().then(|| value.to_owned()),
            });
        }
    }
    Ok(tables)
}
