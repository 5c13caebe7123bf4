//! What does ROS say on the command line?
//!
//! `--ros-args -p name:=value -r from:=to --params-file file.yaml --`, as `ros2 run` and launch
//! files give them. What stands outside of that is the command's own.

use std::path::PathBuf;

use chronotope::error::{Error, ErrorKind, Result};
use chronotope_terminal::yaml::document;
use ros2_client::ParameterValue;
use yaml_rust2::Yaml;

use crate::parameters::Declared;

/// Bytes of a file of parameters, at most.
const MAX_BYTES: u64 = 1 << 20;
const NODE_NAME: &str = "chronotope_node";

/// What the arguments for ROS say.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RosArguments {
    pub(crate) node: String,
    pub(crate) namespace: String,
    /// From and to.
    remaps: Vec<(String, String)>,
    pub(crate) parameters: Vec<(String, ParameterValue)>,
}

/// The command's own arguments, and those for ROS.
pub(crate) fn split(arguments: impl Iterator<Item = String>) -> (Vec<String>, Vec<String>) {
    let (mut own, mut ros) = (Vec::new(), Vec::new());
    let mut is_ros = false;
    for argument in arguments {
        match argument.as_str() {
            "--ros-args" => is_ros = true,
            "--" if is_ros => is_ros = false,
            _ if is_ros => ros.push(argument),
            _ => own.push(argument),
        }
    }
    (own, ros)
}

impl RosArguments {
    /// Of what [`split`] gives.
    pub(crate) fn parse(arguments: &[String]) -> Result<Self> {
        let mut parsed = Self {
            node: NODE_NAME.to_owned(),
            namespace: "/".to_owned(),
            remaps: Vec::new(),
            parameters: Vec::new(),
        };
        let mut files = Vec::new();
        let mut set = Vec::new();
        let mut rest = arguments.iter();
        while let Some(option) = rest.next() {
            let mut value = || {
                rest.next().ok_or_else(|| {
                    wrong(
                        format!("`{option}` is given nothing"),
                        "write name:=value behind it",
                    )
                })
            };
            match option.as_str() {
                "-p" | "--param" => set.push(rule(value()?)?),
                "-r" | "--remap" => {
                    let (from, to) = rule(value()?)?;
                    match from.as_str() {
                        "__node" | "__name" => parsed.node = to,
                        "__ns" => parsed.namespace = to,
                        _ => parsed.remaps.push((from, to)),
                    }
                }
                "--params-file" => files.push(PathBuf::from(value()?)),
                // Of ROS 2's own loggers.
                "--log-level" | "--log-config-file" | "-e" | "--enclave" => {
                    value()?;
                }
                _ if option.starts_with("--enable-") || option.starts_with("--disable-") => {}
                _ => {
                    return Err(wrong(
                        format!("`{option}` is no argument for ROS"),
                        "-p, -r and --params-file are",
                    ));
                }
            }
        }
        if !parsed.namespace.starts_with('/') {
            parsed.namespace.insert(0, '/');
        }
        for file in files {
            let text = fremen::file::read_text(&file, MAX_BYTES)?;
            let found = parsed
                .of_file(&text)
                .map_err(|error| error.with_path(&file))?;
            parsed.parameters.extend(found);
        }
        for (name, text) in set {
            let value =
                document(&text).map_err(|cause| wrong(cause, "write a number or a word"))?;
            let value = parameter(&name, &value)?;
            parsed.parameters.push((name, value));
        }
        Ok(parsed)
    }

    /// What a file says of this node: `NODE: {ros__parameters: {...}}`, with wildcards in names and
    /// namespaces as levels of their own.
    ///
    /// What it says of many nodes may be meant for others, as rclcpp has it, too: of that, unknown
    /// parameters are left out.
    fn of_file(&self, text: &str) -> Result<Vec<(String, ParameterValue)>> {
        let help = "write NODE: {ros__parameters: {map: site.map}}";
        let wrong = |message: String| Error::new(ErrorKind::Format, message).with_help(help);
        let file = document(text).map_err(|cause| wrong(format!("no YAML: {cause}")))?;
        if file.as_hash().is_none() {
            return Err(wrong("it names no node".into()));
        }
        let mut tables = Vec::new();
        tables_of(&file, "", &mut tables);
        let full = format!("{}/{}", self.namespace.trim_end_matches('/'), self.node);
        let mut found = Vec::new();
        for (pattern, says) in tables {
            // A name alone is meant for the node in whatever namespace.
            if !is_meant(&pattern, &full) && pattern.trim_start_matches('/') != self.node {
                continue;
            }
            let is_for_many = pattern.contains('*');
            for (name, value) in says.as_hash().into_iter().flatten() {
                let name = (name.as_str()).ok_or_else(|| wrong("a name is no text".into()))?;
                if is_for_many && Declared::find(name).is_none() {
                    continue;
                }
                found.push((name.to_owned(), parameter(name, value)?));
            }
        }
        Ok(found)
    }

    /// The value that was given last.
    pub(crate) fn parameter(&self, name: &str) -> Option<&ParameterValue> {
        let mut given = self.parameters.iter().rev();
        given.find(|it| it.0 == name).map(|it| &it.1)
    }

    /// The name that a topic or a service has after all remapping; `~/` stands for the node.
    pub(crate) fn resolve(&self, name: &str) -> String {
        let absolute = |name: &str| match (name.strip_prefix("~/"), name.starts_with('/')) {
            (Some(inside), _) => {
                format!(
                    "{}/{}/{inside}",
                    self.namespace.trim_end_matches('/'),
                    self.node
                )
            }
            (None, true) => name.to_owned(),
            (None, false) => format!("{}/{name}", self.namespace.trim_end_matches('/')),
        };
        let full = absolute(name);
        let remapped = self.remaps.iter().find(|(from, _)| absolute(from) == full);
        remapped.map_or(full, |(_, to)| absolute(to))
    }
}

/// Namespaces within namespaces, at most.
const MAX_LEVELS: usize = 32;

/// The tables of parameters below `level`, each with the name of the node that it is for.
fn tables_of<'a>(level: &'a Yaml, name: &str, tables: &mut Vec<(String, &'a Yaml)>) {
    if name.matches('/').count() > MAX_LEVELS {
        return;
    }
    for (key, below) in level.as_hash().into_iter().flatten() {
        match key.as_str() {
            Some("ros__parameters") => tables.push((name.to_owned(), below)),
            Some(key) => tables_of(below, &format!("{name}/{}", key.trim_matches('/')), tables),
            None => {}
        }
    }
}

/// Whether a node's full name fits: `*` stands for one name, `**` for any number of them.
fn is_meant(pattern: &str, name: &str) -> bool {
    fn fits(pattern: &[&str], name: &[&str]) -> bool {
        match (pattern, name) {
            ([], []) => true,
            (["**", rest @ ..], name) => (0..=name.len()).any(|skip| fits(rest, &name[skip..])),
            (["*", pattern @ ..], [_, name @ ..]) => fits(pattern, name),
            ([first, pattern @ ..], [found, name @ ..]) => first == found && fits(pattern, name),
            _ => false,
        }
    }
    let pattern: Vec<&str> = pattern.split('/').filter(|it| !it.is_empty()).collect();
    let name: Vec<&str> = name.split('/').filter(|it| !it.is_empty()).collect();
    fits(&pattern, &name)
}

fn rule(text: &str) -> Result<(String, String)> {
    let parts = text.split_once(":=");
    let (from, to) = parts
        .filter(|(from, _)| !from.is_empty())
        .ok_or_else(|| wrong(format!("`{text}` is no rule"), "write name:=value"))?;
    // Of one node among several in a process.
    let from = from.rsplit_once(':').map_or(from, |(_, name)| name);
    Ok((from.to_owned(), to.to_owned()))
}

/// A value in its parameter's type.
fn parameter(name: &str, value: &Yaml) -> Result<ParameterValue> {
    let declared = Declared::find(name).ok_or_else(|| {
        wrong(
            format!("there is no parameter `{name}`"),
            "chronotope_node --parameters lists them",
        )
    })?;
    let value = match value {
        Yaml::Boolean(value) => ParameterValue::Boolean(*value),
        Yaml::Integer(value) => ParameterValue::Integer(*value),
        Yaml::Real(_) => value
            .as_f64()
            .map_or(ParameterValue::NotSet, ParameterValue::Double),
        Yaml::String(value) => ParameterValue::String(value.clone()),
        Yaml::Null => ParameterValue::String(String::new()),
        _ => ParameterValue::NotSet,
    };
    let value = declared.typed(value);
    declared
        .check(&value)
        .map_err(|cause| wrong(cause, declared.description))?;
    Ok(value)
}

fn wrong(message: String, help: &str) -> Error {
    Error::new(ErrorKind::Config, message).with_help(help)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(words: &[&str]) -> Result<RosArguments> {
        let words: Vec<String> = words.iter().map(ToString::to_string).collect();
        RosArguments::parse(&words)
    }

    #[test]
    fn parameters_and_remaps_are_read() -> Result<()> {
        let arguments = "--verbose --ros-args -p a:=1 -- --parameters".split(' ');
        let (own, ros) = split(arguments.map(str::to_owned));
        assert_eq!((own.len(), ros.len()), (2, 2));
        let parsed = parse(&[
            "-p",
            "map:=a b.map",
            "--param",
            "risk:=1",
            "-r",
            "image:=/camera/image_raw",
            "-r",
            "__ns:=/robot",
            "-p",
            "learn:=true",
            "--log-level",
            "info",
        ])?;
        assert_eq!(
            parsed.parameter("map"),
            Some(&ParameterValue::String("a b.map".into()))
        );
        assert_eq!(parsed.parameter("risk"), Some(&ParameterValue::Double(1.0)));
        assert_eq!(
            parsed.parameter("learn"),
            Some(&ParameterValue::Boolean(true))
        );
        assert_eq!(parsed.resolve("image"), "/camera/image_raw");
        assert_eq!(parsed.resolve("current_node"), "/robot/current_node");
        assert_eq!(parsed.resolve("~/commit"), "/robot/chronotope_node/commit");
        Ok(())
    }

    #[test]
    fn files_say_what_they_mean_for_this_node() -> Result<()> {
        let parsed = parse(&[])?;
        let text = "/**:\n  ros__parameters:\n    map: site.map\n    late_s: 2\nother:\n  \
                    ros__parameters: {rotate: 90}\n/chronotope_node:\n  ros__parameters: {rotate: 180}\n";
        let found = parsed.of_file(text)?;
        assert_eq!(found.len(), 3);
        assert_eq!(found[1].1, ParameterValue::Double(2.0));
        assert_eq!(found[2].1, ParameterValue::Integer(180));
        for wrong in [
            "",
            "[",
            "chronotope_node:\n  ros__parameters: {mop: 1}\n",
            "/**:\n  ros__parameters: {map: [1]}\n",
        ] {
            assert!(parsed.of_file(wrong).is_err(), "{wrong}");
        }
        Ok(())
    }

    #[test]
    fn one_file_can_serve_all_nodes_of_a_robot() -> Result<()> {
        let parsed = parse(&["-r", "__ns:=/robot/front"])?;
        let values = |text: &str| -> Result<Vec<String>> {
            let found = parsed.of_file(text)?;
            Ok(found.into_iter().map(|(name, _)| name).collect())
        };
        for pattern in [
            "/**",
            "/robot/**",
            "/**/chronotope_node",
            "/robot/*/chronotope_node",
            "/*/*/*",
            "/robot/front/chronotope_node",
            "robot: {front: {chronotope_node",
            "chronotope_node",
        ] {
            let open = pattern.matches('{').count();
            let text = format!(
                "{pattern}: {{ros__parameters: {{rotate: 90}}}}{}",
                "}".repeat(open)
            );
            assert_eq!(values(&text)?, ["rotate"], "{text}");
        }
        for pattern in [
            "/*",
            "/robot/*",
            "/other/chronotope_node",
            "/**/driver",
            "/front/**",
        ] {
            let text = format!("{pattern}: {{ros__parameters: {{mop: 90}}}}");
            assert!(values(&text)?.is_empty(), "{text}");
        }
        // Whatever else the nodes of a robot are told.
        let text =
            "/**: {ros__parameters: {use_sim_time: true, frame_id: map, qos_overrides: {a: 1}}}";
        assert_eq!(values(text)?, ["use_sim_time"]);
        Ok(())
    }

    #[test]
    fn what_makes_no_sense_is_refused_with_what_helps() {
        for (words, told) in [
            (&["-p"][..], "nothing"),
            (&["-p", "map"], "name:=value"),
            (&["-p", "mop:=1"], "--parameters"),
            (&["-p", "rotate:=45"], "180"),
            (&["--what"], "--params-file"),
        ] {
            let error = parse(words).expect_err("nonsense").to_string();
            assert!(error.contains(told), "{words:?}: {error}");
        }
    }
}
