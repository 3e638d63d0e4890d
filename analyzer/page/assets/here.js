// What the core says of commands and options, in words for who has this page only.
const Here = (() => {
  const KNOWN = "“What is known of the recording”";
  const TABS = { transactions: "Transactions", frames: "Frames", findings: "Findings", connections: "Connections" };
  const SAID = [
    [/modlens show FILE --at UNIT:hr:ADDRESS --as all shows (?:the values in )?every order/g, "change it there, and drop the profile on this page again"],
    [/modlens tap PORT without --line finds those of a line by listening/g, "listening on this page without settings finds those of a line (in Chromium and Edge)"],
    [/modlens show names each transaction(.{1,6}?)s own reason/g, "a row that is opened names its own reason"],
    [/such as one of modlens tap/g, "such as one made by the command modlens tap"],
    [/The baud rate in --line; without --line modlens finds it/g, `The baud rate under ${KNOWN}; where that is empty, it is found`],
    [/The baud rate in --line/g, `The baud rate under ${KNOWN}`],
    [/the --line setting/g, `the line under ${KNOWN}`],
    [/an option, for example --line (\S+)/g, `the line under ${KNOWN}, for example $1`],
    [/give the settings by --line/g, "give the settings"],
    [/--line gives settings, and modlens decode --detect tries them on a recording/g, "give the settings, if they are known"],
    [/modlens explain exception N/g, "it stands beside its byte in the row that is opened"],
    [/modlens decode --functions NAME\|FILE loads/g, "with the command line, modlens decode --functions NAME|FILE loads"],
    [/see `modlens formats`, or choose one with --from/g, `if it is Modbus, name its format under ${KNOWN}`],
    [/see `modlens formats`/g, `leave the format under ${KNOWN} empty, or name another`],
    [/use --from (\S+) to decode it anyway/g, `to decode it anyway, name $1 as format under ${KNOWN}`],
    [/leave --from out, or use --from (\S+)/g, "leave the format empty, or name $1"],
    [/named by --from/g, "named by hand"],
    [/\(try --port\)/g, `(their port can be given under ${KNOWN})`],
    [/, or --between for less time/g, "; with the command line, --between takes less time of it"],
    [/listed by `modlens explain`/g, "those in the rows"],
    [/; modlens (?:explain CODE describes it|show FILE --txn N shows one)/g, ""],
    [/with --table (\w+)/g, (option, name) => (TABS[name] ? `on ${TABS[name]}` : `with the command line and ${option.slice(5)}`)],
  ];

  const text = (said = "") => SAID.reduce((so, [from, to]) => so.replace(from, to), said);

  return { text };
})();
